// A leg of one lane as forces and contacts see it. All of it is inlined, into each copy for an instruction set.
#pragma once

#include <cmath>

#include "rom/native/native.hpp"

#define ROMGRL_INLINE __attribute__((always_inline)) inline

namespace romgrl {

constexpr double kPi = 3.14159265358979323846;

ROMGRL_INLINE double larger(double a, double b) { return a > b ? a : b; }
ROMGRL_INLINE double smaller(double a, double b) { return a < b ? a : b; }
ROMGRL_INLINE double clamped(double value, double low, double high) { return smaller(larger(value, low), high); }

// Angle of the unit vector (cosine, sine): twice the arctangent of the half angle's tangent, which is in [0, 1] in the
// right half plane. The polynomial is a Chebyshev fit of atan(t) / t in t^2: the angle's error is below 2e-10 rad.
ROMGRL_INLINE double angle_of(double cosine, double sine) {
    const double t = std::fabs(sine) / (1.0 + std::fabs(cosine));
    const double s = t * t;
    double p = -0.0006804973376892177;
    p = p * s + 0.004827228128556806;
    p = p * s - 0.0160551614781314;
    p = p * s + 0.034133424113205205;
    p = p * s - 0.05421530938017452;
    p = p * s + 0.0724228419757871;
    p = p * s - 0.08979051070501506;
    p = p * s + 0.1109298479297178;
    p = p * s - 0.14283948422103546;
    p = p * s + 0.19999909957098133;
    p = p * s - 0.33333331518201503;
    p = p * s + 0.9999999999390128;
    const double right = 2.0 * t * p;
    return std::copysign(cosine < 0.0 ? kPi - right : right, sine);
}

struct Leg {
    double length, inverse_lever, along_x, along_y, rate, angle, angle_rate;
    bool contact;
};

ROMGRL_INLINE Leg look(const NativeConstants& c, const Group& g, const Body& foot, int n) {
    const double dx = foot.x[n] - g.trunk.x[n], dy = foot.y[n] - g.trunk.y[n];
    const double vx = foot.vx[n] - g.trunk.vx[n], vy = foot.vy[n] - g.trunk.vy[n];
    Leg leg;
    leg.length = std::sqrt(dx * dx + dy * dy);
    const double inverse = 1.0 / larger(leg.length, 1e-30);
    leg.inverse_lever = smaller(inverse, c.inverse_shortest_lever);
    leg.along_x = dx * inverse;
    leg.along_y = leg.length > 0.0 ? dy * inverse : -1.0;
    leg.rate = leg.along_x * vx + leg.along_y * vy;
    leg.angle = angle_of(-leg.along_y, leg.along_x);
    leg.angle_rate = (leg.along_x * vy - leg.along_y * vx) * leg.inverse_lever;
    leg.contact = foot.y[n] <= c.arc.touch(leg.along_y);
    return leg;
}

}  // namespace romgrl
