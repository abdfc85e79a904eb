// A foot that rolls: an arc of radius R, rigid with the leg, whose centre is on the leg's axis, d = R - foot_radius above
// the leg's end, so that a leg that stands upright is as tall as on a circle (McGeer 1990, Int. J. Robotics Research 9:62).
//
// u: unit vector from hip to foot, t = (-u_y, u_x), l: length, w = t (v_foot - v_hip), so that the leg turns at w / l.
//   lowest point of the arc   p = p_foot - d u - (0, R), which touches the ground where y_foot <= R + d u_y
//   its velocity              v_x = v_foot_x + a_t w,  v_y = v_foot_y + a_n w,  a_t = (R + d u_y) / l,  a_n = -d u_x / l
// An impulse (T, N) at p does the work T v_x + N v_y in any motion of foot and hip. The leg has no mass between them, so
// that by virtual work they get J^T (T, N):
//   foot: (T, N) + C t,  hip: -C t,  C = a_t T + a_n N      (the moment about the leg's end, carried across the leg)
// Both feet meet the trunk as it was before either: what one does to the other through it, a share of at most about the
// foot's mass over the trunk's, comes in the next substep. Both engines use these functions.
#pragma once

#include <cmath>

#include "rom/parameters.hpp"

namespace romgrl {

struct ArcFoot {
    explicit ArcFoot(const Parameters& p)
        : rolls(p.roll_over_radius > 0.0),
          radius(rolls ? p.roll_over_radius : p.foot_radius),
          offset(radius - p.foot_radius),
          friction(p.friction),
          mass_ratio(p.trunk_pinned ? 0.0 : p.foot_mass / (p.mass - 2.0 * p.foot_mass)) {}

    // Height of a leg's end at which its foot touches the ground. Without rolling it is foot_radius, bit for bit.
    double touch(double along_y) const { return radius + offset * along_y; }

    bool rolls;
    double radius, offset;  // R, d: m; without rolling the circle's radius and 0
    double friction, mass_ratio;  // of foot and trunk; 0: the trunk is held
};

struct ArcImpulse {
    double tangent, normal, across;  // T, N, C per foot mass, m/s
};

// What the ground gives a foot that touches it, from the velocities after the forces: of the foot, and its part across the
// leg relative to the hip. With K = J M^-1 J^T per foot mass, Coulomb friction and no bounce:
//   v_n + K_nn N + K_nt T = 0 where v_n < 0, else N = T = 0;  T stops the slip or is at the end of the cone, |T| = mu N
// As a function of T, N = -(v_n + K_nt T) / K_nn, and the slip grows with T: T is what stops it, clipped where it meets
// the cone, at T = s mu N, N = -v_n / (K_nn + s mu K_nt), s the sign of T.
__attribute__((always_inline)) inline ArcImpulse arc_impulse(const ArcFoot& arc, double along_x, double along_y,
                                                             double inverse_length, bool touches, double vx, double vy,
                                                             double across) {
    constexpr double kLeast = 1e-9;  // keeps what is out of reach finite
    const auto larger = [](double a, double b) { return a > b ? a : b; };
    const double a_t = arc.touch(along_y) * inverse_length, a_n = -arc.offset * along_x * inverse_length;
    const double tx = -along_y, ty = along_x;
    const double slip = vx + a_t * across, v_n = vy + a_n * across;
    const double whole = 1.0 + arc.mass_ratio;
    const double k_nn = larger(1.0 + 2.0 * a_n * ty + whole * a_n * a_n, kLeast);
    const double k_tt = 1.0 + 2.0 * a_t * tx + whole * a_t * a_t;
    const double k_nt = a_n * tx + a_t * ty + whole * a_n * a_t;
    const double determinant = larger(k_nn * k_tt - k_nt * k_nt, kLeast);
    const double stops = k_nt * v_n - k_nn * slip;  // T that stops the slip, times the determinant
    const double cone = larger(k_nn + std::copysign(arc.friction, stops) * k_nt, kLeast);
    const double inverse = 1.0 / (k_nn * determinant * cone);  // one division in the place of three
    const double sticks = stops * (k_nn * cone * inverse);
    const double most = -arc.friction * v_n * (k_nn * determinant * inverse);
    const double tangent = std::fabs(sticks) > most ? std::copysign(most, sticks) : sticks;
    const double normal = -(v_n + k_nt * tangent) * (determinant * cone * inverse);
    const bool pressed = touches & (v_n < 0.0);
    const double t = pressed ? tangent : 0.0, n = pressed ? normal : 0.0;
    return {t, n, a_t * t + a_n * n};
}

// By how much a foot below the ground is lifted in one substep, as Box2D does it: below, m.
__attribute__((always_inline)) inline double lift(double below) {
    const double asked = kCorrection * (below - kSlop);
    const double least = asked > 0.0 ? asked : 0.0;
    return least < kLargestCorrection ? least : kLargestCorrection;
}

}  // namespace romgrl
