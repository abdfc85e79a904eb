// A world as numbers: what placing, saving and restoring exchange with an engine. SI units, angles in rad.
//
//  0.. 5  trunk: x from the origin, y, angle (counter-clockwise: minus pitch), and their rates
//  6..11  foot of slot 0, likewise;  12..17  foot of slot 1
// 18      slot of the left leg: which leg is solved first
// 19      x of the origin in the world;  20  x of the trunk at the last touchdown;  21  its side: 1 left, -1 right, 0 none
// 22      share of the stiffness;  23  time since the last touchdown, or since the reset
// 24..30  left leg: motor torque, shortening of the rest length, angle at touchdown, 1 if airborne; extension of the rest
//         length, its rate, drive of the leg's motor;  31..37  right leg
#pragma once

#include <array>

#include "rom/parameters.hpp"

namespace romgrl {

constexpr int kLegs = 2;
constexpr int kMotion = 24, kLegMotion = 7;  // first number of the left leg, and how many a leg has
constexpr int kWalkerState = kMotion + kLegs * kLegMotion;

// Where to put a world: SI units, the order of the legs is left, right.
struct Pose {
    double x = 0.0, y = 1.0, vx = 0.0, vy = 0.0, pitch = 0.0, pitch_rate = 0.0;
    std::array<double, kLegs> hip_angle{}, hip_rate{}, leg_length{}, leg_rate{}, extension{}, extension_rate{};
};

// Throws std::invalid_argument if the pose is not finite, too large, or has a leg of no length.
void pose_state(const Parameters& parameters, const Pose& pose, double* state);
bool is_walker_state(const double* state);

}  // namespace romgrl
