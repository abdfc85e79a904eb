// Everything that fixes a spring-leg world, in SI units. x points forward, y up.
#pragma once

#include <limits>

namespace romgrl {

struct Parameters {
    double mass = 71.8;  // total, feet included
    double leg_length = 0.865;  // rest length from hip (trunk centre) to foot centre
    double foot_radius = 0.072;
    double foot_mass = 0.9;  // each
    double stiffness = 24000.0;
    double stance_damping = 30.0;
    double swing_damping = 140.0;
    double hip_torque = 60.0;
    double torque_lag = 0.02;  // time constant; 0: none
    double trunk_moment_limit = 25.0;  // infinity: none
    double retraction = 0.15;  // share of leg_length
    double retraction_time = 0.08;
    double hip_angle_limit = 1.3;
    double compression_limit = 0.5;  // share of leg_length
    double extension_limit = 1.05;  // share of leg_length
    double friction = 1.0;
    bool trunk_locked = true;
    bool trunk_pinned = false;  // holds the trunk where it is placed; for tests of a single leg
    double trunk_inertia = 3.0;
    double trunk_pitch_limit = 1.0;
    double fall_height = 0.6;  // share of leg_length
    int substeps = 16;
    int velocity_iterations = 8;
    int position_iterations = 3;
    double gravity = 9.81;

    double reset_hip_angle_low = 0.25;
    double reset_hip_angle_high = 0.40;
    double reset_speed_low = 0.5;  // share of speed
    double reset_speed_high = 1.1;
    double speed = 4.0;
    double control_frequency = 30.0;
    int episode_steps = 400;
    double alpha = 1.0;
    bool reward_is_velocity = false;
    bool observation_is_paper = false;
    bool engine_is_native = false;

    double substep_time() const { return 1.0 / (control_frequency * substeps); }
};

// Numbers that the engines share.
constexpr double kShift = 4.0;  // m; the origin follows the trunk in such steps. A power of two: moving rounds nothing
constexpr double kLargestPosition = 1e3;  // m, rad; a state beyond these has diverged
constexpr double kLargestVelocity = 200.0;  // m/s, rad/s
constexpr double kShortestLever = 0.05;  // share of leg_length; keeps torque / length finite
constexpr double kHipStopFrequency = 0.3;  // rad per substep

// Throws std::invalid_argument naming the first parameter that is not finite, out of range, or unstable to integrate.
void validate(const Parameters& parameters);

}  // namespace romgrl
