// Everything that fixes a spring-leg world, in SI units. x points forward, y up.
#pragma once

#include <limits>

namespace romgrl {

constexpr double kUnlimited = std::numeric_limits<double>::infinity();

// One row per parameter: type, name, default, least, most. Struct, checks and bindings are made of it.
// Lengths that are shares are of leg_length; feet count in the mass; a leg's rest length ends at the foot's centre.
#define ROMGRL_PARAMETERS(ROW)                                       \
    ROW(double, mass, 71.8, 1e-2, 1e6)                               \
    ROW(double, foot_mass, 0.7, 1e-4, 1e5)                           \
    ROW(double, leg_length, 0.865, 0.05, 2.0)                        \
    ROW(double, foot_radius, 0.072, 1e-3, 1.0)                       \
    ROW(double, roll_over_radius, 0.0, 0.0, 2.0)                     \
    ROW(double, stiffness, 24000.0, 1e-3, 1e9)                       \
    ROW(double, stance_damping, 30.0, 0.0, 1e7)                      \
    ROW(double, swing_damping, 140.0, 0.0, 1e7)                      \
    ROW(double, hip_torque, 60.0, 0.0, 1e5)                          \
    ROW(double, torque_lag, 0.02, 0.0, 100.0)                        \
    ROW(double, trunk_moment_limit, 25.0, 0.0, ::romgrl::kUnlimited) \
    ROW(double, retraction, 0.15, 0.0, 0.4)                          \
    ROW(double, retraction_time, 0.08, 1e-6, 100.0)                  \
    ROW(bool, leg_motor, false, 0.0, 1.0)                            \
    ROW(double, motor_force, 1436.0, 1e-3, 1e6)                      \
    ROW(double, motor_speed, 3.0, 1e-3, 100.0)                       \
    ROW(double, motor_power, 1077.0, 1e-3, 1e7)                      \
    ROW(double, motor_eccentric, 1.5, 1.0, 10.0)                     \
    ROW(double, motor_eccentric_speed, 1.0, 1e-3, 100.0)             \
    ROW(double, motor_mass, 2.5, 1e-3, 1e9)                          \
    ROW(double, motor_damping, 0.0, 0.0, 1e6)                        \
    ROW(double, motor_lag, 0.02, 0.0, 100.0)                         \
    ROW(double, shortest_rest, 0.95, 0.05, 1.0)                      \
    ROW(double, longest_rest, 1.05, 1.0, 1.5)                        \
    ROW(double, hip_angle_limit, 1.3, 0.01, 1.57)                    \
    ROW(double, compression_limit, 0.5, 0.05, 1.0)                   \
    ROW(double, extension_limit, 1.05, 1.0, 2.0)                     \
    ROW(double, friction, 1.0, 0.0, 100.0)                           \
    ROW(bool, trunk_locked, true, 0.0, 1.0)                          \
    ROW(bool, trunk_pinned, false, 0.0, 1.0)                         \
    ROW(double, trunk_inertia, 3.0, 1e-4, 1e6)                       \
    ROW(double, trunk_pitch_limit, 1.0, 0.01, 10.0)                  \
    ROW(double, fall_height, 0.6, 0.0, 1.0)                          \
    ROW(int, substeps, 16, 1, 10000)                                 \
    ROW(int, velocity_iterations, 8, 1, 1000)                        \
    ROW(int, position_iterations, 3, 1, 1000)                        \
    ROW(double, gravity, 9.81, 0.0, 100.0)                           \
    ROW(double, speed_low, 4.0, 0.0, 10.0)                           \
    ROW(double, speed_high, 4.0, 0.0, 10.0)                          \
    ROW(double, stiffness_share_low, 1.0, 0.1, 10.0)                 \
    ROW(double, stiffness_share_high, 1.0, 0.1, 10.0)                \
    ROW(double, apex_low, 0.0, 0.0, 2.0)                             \
    ROW(double, apex_high, 0.0, 0.0, 2.0)                            \
    ROW(int, command_steps, 0, 0, 1e9)                               \
    ROW(bool, reset_together, false, 0.0, 1.0)                       \
    ROW(bool, reset_by_speed, false, 0.0, 1.0)                       \
    ROW(double, control_frequency, 30.0, 1.0, 10000.0)               \
    ROW(int, episode_steps, 400, 1, 1e9)                             \
    ROW(double, alpha, 1.0, 1e-9, 1e6)                               \
    ROW(double, work_cost, 0.0, 0.0, 1e3)                            \
    ROW(bool, reward_is_velocity, false, 0.0, 1.0)                   \
    ROW(bool, observation_is_paper, false, 0.0, 1.0)                 \
    ROW(bool, engine_is_native, false, 0.0, 1.0)

// Ranges from which resets are drawn; their bounds depend on other parameters. Speeds are shares of the world's speed, with
// reset_by_speed angles are those at sqrt(g L0); a drop is the height that the trunk has fallen by, m.
#define ROMGRL_RESETS(ROW)                  \
    ROW(double, reset_hip_angle_low, 0.33)  \
    ROW(double, reset_hip_angle_high, 0.42) \
    ROW(double, reset_speed_low, 0.9)       \
    ROW(double, reset_speed_high, 1.05)     \
    ROW(double, reset_drop_low, 0.0)        \
    ROW(double, reset_drop_high, 0.0)

struct Parameters {
    // trunk_moment_limit: infinity is none; torque_lag: 0 is none; roll_over_radius: 0 is a foot that does not roll; trunk_pinned holds the trunk for tests of a single leg;
    // speed, share of the stiffness and apex, the rise of a jump over a trunk that stands, m, are drawn for each episode
    // and anew after every command_steps (0: never)
#define ROW(type, name, value, ...) type name = value;
    ROMGRL_PARAMETERS(ROW)
    ROMGRL_RESETS(ROW)
#undef ROW

    double substep_time() const { return 1.0 / (control_frequency * substeps); }
};

// Numbers that the engines share.
constexpr double kShift = 4.0;  // m; the origin follows the trunk in such steps. A power of two: moving rounds nothing
constexpr double kLargestPosition = 1e3;  // m, rad; a state beyond these has diverged
constexpr double kLargestVelocity = 200.0;  // m/s, rad/s
constexpr double kShortestLever = 0.05;  // share of leg_length; keeps torque / length finite
constexpr double kHipStopFrequency = 0.3;  // rad per substep
// Box2D leaves some penetration and corrects a share of the rest.
constexpr double kSlop = 0.005;  // m
constexpr double kCorrection = 0.2;
constexpr double kLargestCorrection = 0.2;  // m

// Throws std::invalid_argument naming the first parameter that is not finite, out of range, or unstable to integrate.
void validate(const Parameters& parameters);

}  // namespace romgrl
