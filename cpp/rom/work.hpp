// What the actuators of a world do: the hip motors, the retraction, which moves the rest length of the legs by a script,
// and the leg motors, which move it by a force.
#pragma once

namespace romgrl {

// Of one control step, in J. Springs, dampers and stops are no actuators.
struct Work {
    double hip = 0.0, positive_hip = 0.0;  // absolute values summed over legs and substeps, and the positive ones alone
    double retraction = 0.0, positive_retraction = 0.0;
    double leg_motor = 0.0, positive_leg_motor = 0.0;

    double positive() const { return positive_hip + positive_retraction + positive_leg_motor; }
};

}  // namespace romgrl
