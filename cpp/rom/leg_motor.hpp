// The motor in series with a leg's spring: a carriage that moves the end of the spring's rest length. SI units.
//
//   m e'' = F_m - F - b e'      e: extension of the rest length, F: spring and damper of the leg, which pushes the carriage back
//   F_m = u F_max g(v)          u: drive in [-1, 1]; v: e' along the motor's push
//   g = 1 - v / v_max, at least 0, where the motor wins (v >= 0); 1 + (eccentric - 1) |v| / v_ecc, at most `eccentric`,
//       where it is overpowered; F_m e' is at most P_max
//
// The carriage stops dead at the ends of its stroke. Both engines use these functions.
#pragma once

#include <cmath>

#include "rom/parameters.hpp"

namespace romgrl {

struct LegMotor {
    explicit LegMotor(const Parameters& p)
        : dt(p.substep_time()),
          lag_gain(p.motor_lag > 0.0 ? -std::expm1(-p.substep_time() / p.motor_lag) : 1.0),
          force(p.motor_force),
          inverse_speed(1.0 / p.motor_speed),
          power(p.motor_power),
          eccentric(p.motor_eccentric),
          eccentric_gain((p.motor_eccentric - 1.0) / p.motor_eccentric_speed),
          inverse_mass(1.0 / p.motor_mass),
          damping(p.motor_damping),
          lowest((p.shortest_rest - 1.0) * p.leg_length),
          highest((p.longest_rest - 1.0) * p.leg_length) {}

    double dt, lag_gain, force, inverse_speed, power, eccentric, eccentric_gain, inverse_mass, damping;
    double lowest, highest;  // extension, m
};

struct Carriage {
    double extension, rate;  // m, m/s
    double force;  // of the motor, N
    double work;  // of the motor on the carriage, J
};

// One substep of the carriage against a leg that pushes with `load` N.
__attribute__((always_inline)) inline Carriage move_carriage(const LegMotor& c, double drive, double extension, double rate,
                                                             double load) {
    const auto larger = [](double a, double b) { return a > b ? a : b; };
    const auto smaller = [](double a, double b) { return a < b ? a : b; };
    const double side = drive < 0.0 ? -1.0 : 1.0;
    const double v = side * rate;
    const double wins = larger(1.0 - v * c.inverse_speed, 0.0);
    const double yields = smaller(1.0 - v * c.eccentric_gain, c.eccentric);
    const double asked = std::fabs(drive) * c.force * (v >= 0.0 ? wins : yields);
    // Along the push, the carriage's mean rate in this substep is a + b F, and F (a + b F) is at most P.
    const double b = 0.5 * c.dt * c.inverse_mass;
    const double a = v - b * (side * load + c.damping * v);
    const double most = (std::sqrt(a * a + 4.0 * b * c.power) - a) / (2.0 * b);
    const double force = side * smaller(asked, most);
    const double free = rate + 2.0 * b * (force - load - c.damping * rate);
    const double inverse_dt = 1.0 / c.dt;
    const double next = smaller(larger(free, (c.lowest - extension) * inverse_dt), (c.highest - extension) * inverse_dt);
    return {extension + c.dt * next, next, force, 0.5 * c.dt * force * (rate + next)};
}

}  // namespace romgrl
