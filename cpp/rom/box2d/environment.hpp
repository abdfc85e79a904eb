// One world in Box2D as a task: observation, reward, termination.
#pragma once

#include <array>
#include <cstdint>

#include "rom/box2d/physics.hpp"
#include "rom/engine.hpp"

namespace romgrl {

struct Outcome {
    float reward = 0.0F;
    float forward_velocity = 0.0F;  // mean of the trunk over the control step, m/s
    bool terminated = false;
    bool truncated = false;
    bool diverged = false;
};

class Environment {
  public:
    Environment(const Parameters& parameters, std::uint64_t index, const ResetBank& bank);

    void seed(std::uint64_t value) { episode_.restart(value); }
    void reset();  // places the next random episode
    void place(const Pose& pose);
    Outcome step(const float* action);
    bool take_command();  // another speed and stiffness, if they are due

    void observe(float* observation) const;
    void features(float* output) const;
    void contact(bool* output) const;
    const Walker& walker() const { return walker_; }
    const Parameters& parameters() const { return parameters_; }

    void save(double* state) const;
    void restore(const double* state);

  private:
    void observe_full(float* observation) const;

    Parameters parameters_;
    const ResetBank& bank_;
    Walker walker_;
    Episode episode_;
};

}  // namespace romgrl
