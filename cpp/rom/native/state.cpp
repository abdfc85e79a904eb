// Lanes of the native engine: constants, and worlds going in and coming out.
#include <algorithm>
#include <cmath>

#include "rom/native/native.hpp"

namespace romgrl {
namespace {

bool sane(const Body& body, int n) {  // false for NaN
    return std::fabs(body.x[n]) + std::fabs(body.y[n]) < kLargestPosition &&
           std::fabs(body.vx[n]) + std::fabs(body.vy[n]) < kLargestVelocity;
}

}  // namespace

NativeConstants::NativeConstants(const Parameters& p)
    : dt(p.substep_time()),
      lag_gain(p.torque_lag > 0.0 ? -std::expm1(-dt / p.torque_lag) : 1.0),
      leg_length(p.leg_length),
      foot_radius(p.foot_radius),
      inverse_shortest_lever(1.0 / (kShortestLever * p.leg_length)),
      arc(p),
      stiffness(p.stiffness),
      stance_damping(p.stance_damping),
      swing_damping(p.swing_damping),
      retraction(p.retraction * p.leg_length),
      retraction_change(retraction * dt / p.retraction_time),
      hip_angle_limit(p.hip_angle_limit),
      stop_stiffness(p.foot_mass * std::pow(kHipStopFrequency / dt, 2)),
      stop_damping(2.0 * p.foot_mass * kHipStopFrequency / dt),
      moment_limit(p.trunk_moment_limit),
      friction(p.friction),
      foot_inverse_mass(1.0 / p.foot_mass),
      trunk_inverse_mass(p.trunk_pinned ? 0.0 : 1.0 / (p.mass - kLegs * p.foot_mass)),
      trunk_inverse_inertia(p.trunk_pinned || p.trunk_locked ? 0.0 : 1.0 / p.trunk_inertia),
      motor(p),
      has_motor(p.leg_motor),
      foot_fall(dt * p.gravity),
      trunk_fall(p.trunk_pinned ? 0.0 : foot_fall),
      shortest(p.compression_limit * p.leg_length),
      longest(p.extension_limit * p.leg_length),
      substeps(p.substeps),
      velocity_iterations(p.velocity_iterations),
      position_iterations(p.position_iterations) {}

bool sane(const Group& g, int n) {
    return sane(g.trunk, n) && sane(g.leg[0].foot, n) && sane(g.leg[1].foot, n) &&
           std::fabs(g.angle[n]) < kLargestPosition && std::fabs(g.rate[n]) < kLargestVelocity &&
           std::fabs(g.leg[0].extension_rate[n]) < kLargestVelocity && std::fabs(g.leg[1].extension_rate[n]) < kLargestVelocity;
}

void copy_lane(const Group& from, int n, Group& to) {
    static_assert(sizeof(Group) % sizeof(Lanes) == 0);
    const auto* source = reinterpret_cast<const Lanes*>(&from);
    auto* target = reinterpret_cast<Lanes*>(&to);
    for (std::size_t i = 0; i < sizeof(Group) / sizeof(Lanes); ++i) target[i][n] = source[i][n];
}

void put_lane(const double* state, bool pinned, int n, Group& g) {
    const auto put_body = [n](Body& body, const double* numbers, bool still) {
        body.x[n] = numbers[0];
        body.y[n] = numbers[1];
        body.vx[n] = still ? 0.0 : numbers[3];
        body.vy[n] = still ? 0.0 : numbers[4];
    };
    put_body(g.trunk, state, pinned);
    g.angle[n] = state[2];
    g.rate[n] = pinned ? 0.0 : state[5];
    g.left_slot[n] = state[18];
    g.origin[n] = state[19];
    g.touchdown_x[n] = state[20];
    g.touchdown_side[n] = state[21];
    g.stiffness_share[n] = state[22];
    g.touchdown_age[n] = state[23];
    for (int i = 0; i < kLegs; ++i) {
        put_body(g.leg[i].foot, state + 6 + 6 * i, false);
        LegLanes& leg = g.leg[slot_of(g, n, i)];
        const double* motion = state + kMotion + kLegMotion * i;
        leg.torque[n] = motion[0];
        leg.shortening[n] = motion[1];
        leg.touchdown_angle[n] = motion[2];
        leg.airborne[n] = motion[3];
        leg.extension[n] = motion[4];
        leg.extension_rate[n] = motion[5];
        leg.drive[n] = motion[6];
        leg.ground_impulse[n] = leg.hip_torque[n] = 0.0;
    }
}

void get_lane(const Group& g, int n, double* state) {
    const auto get_body = [n](const Body& body, double angle, double rate, double* numbers) {
        const double values[6] = {body.x[n], body.y[n], angle, body.vx[n], body.vy[n], rate};
        std::copy_n(values, 6, numbers);
    };
    get_body(g.trunk, g.angle[n], g.rate[n], state);
    state[18] = g.left_slot[n];
    state[19] = g.origin[n];
    state[20] = g.touchdown_x[n];
    state[21] = g.touchdown_side[n];
    state[22] = g.stiffness_share[n];
    state[23] = g.touchdown_age[n];
    for (int i = 0; i < kLegs; ++i) {
        get_body(g.leg[i].foot, 0.0, 0.0, state + 6 + 6 * i);
        const LegLanes& leg = g.leg[slot_of(g, n, i)];
        const double values[kLegMotion] = {leg.torque[n],    leg.shortening[n],     leg.touchdown_angle[n], leg.airborne[n],
                                           leg.extension[n], leg.extension_rate[n], leg.drive[n]};
        std::copy_n(values, kLegMotion, state + kMotion + kLegMotion * i);
    }
}

}  // namespace romgrl
