// Box2D's sequential impulses for one lane of the native engine: the length stops of both legs and both contacts. Those of
// feet that roll are solved before.
#include <algorithm>
#include <cmath>

#include "rom/native/native.hpp"

namespace romgrl {

void solve_velocities(const NativeConstants& c, const Scratch& s, int n, Group& g) {
    double lower[kLegs]{}, upper[kLegs]{}, normal[kLegs]{}, tangent[kLegs]{};
    Body& trunk = g.trunk;
    for (int i = 0; i < kLegs && !c.arc.rolls; ++i) {
        g.leg[i].foot.vx[n] = s.leg[i].free_vx[n];
        g.leg[i].foot.vy[n] = s.leg[i].free_vy[n];
        if (s.leg[i].contact[n] > 0.0) g.leg[i].ground_impulse[n] -= std::max(-s.leg[i].free_vy[n], 0.0);
    }
    const double mass = 1.0 / (c.trunk_inverse_mass + c.foot_inverse_mass);
    for (int iteration = 0; iteration < c.velocity_iterations; ++iteration) {
        for (int i = kLegs - 1; i >= 0; --i) {  // Box2D's order of the joints
            const LegScratch& leg = s.leg[i];
            Body& foot = g.leg[i].foot;
            const auto rate = [&] {
                return leg.along_x[n] * (foot.vx[n] - trunk.vx[n]) + leg.along_y[n] * (foot.vy[n] - trunk.vy[n]);
            };
            const auto push = [&](double impulse) {
                foot.vx[n] += c.foot_inverse_mass * impulse * leg.along_x[n];
                foot.vy[n] += c.foot_inverse_mass * impulse * leg.along_y[n];
                trunk.vx[n] -= c.trunk_inverse_mass * impulse * leg.along_x[n];
                trunk.vy[n] -= c.trunk_inverse_mass * impulse * leg.along_y[n];
            };
            const double room = std::max(leg.length[n] - c.shortest, 0.0) / c.dt;
            const double old_lower = lower[i];
            lower[i] = std::max(lower[i] - mass * (rate() + room), 0.0);
            push(lower[i] - old_lower);
            const double reach = std::max(c.longest - leg.length[n], 0.0) / c.dt;
            const double old_upper = upper[i];
            upper[i] = std::max(upper[i] - mass * (reach - rate()), 0.0);
            push(old_upper - upper[i]);
        }
        for (int i = 0; i < kLegs && !c.arc.rolls; ++i) {
            if (s.leg[i].contact[n] == 0.0) continue;
            Body& foot = g.leg[i].foot;
            const double grip = c.friction * normal[i];
            const double old_tangent = tangent[i], old_normal = normal[i];
            tangent[i] = std::clamp(tangent[i] - foot.vx[n], -grip, grip);
            foot.vx[n] += tangent[i] - old_tangent;
            normal[i] = std::max(normal[i] - foot.vy[n], 0.0);
            foot.vy[n] += normal[i] - old_normal;
        }
    }
    for (int i = 0; i < kLegs; ++i) g.leg[i].ground_impulse[n] += normal[i];
}

void solve_positions(const NativeConstants& c, const Scratch& s, int n, Group& g) {
    const double mass = 1.0 / (c.trunk_inverse_mass + c.foot_inverse_mass);
    for (int i = 0; i < kLegs; ++i) g.leg[i].foot.y[n] = s.leg[i].free_y[n];
    for (int iteration = 0; iteration < c.position_iterations; ++iteration) {
        bool done = true;
        for (int i = 0; i < kLegs && !c.arc.rolls; ++i) {
            if (s.leg[i].contact[n] == 0.0) continue;
            double& y = g.leg[i].foot.y[n];
            const double below = c.foot_radius - y;
            done &= below <= 3.0 * kSlop;
            y += lift(below);
        }
        for (int i = kLegs - 1; i >= 0; --i) {
            Body& foot = g.leg[i].foot;
            const double dx = foot.x[n] - g.trunk.x[n], dy = foot.y[n] - g.trunk.y[n];
            const double length = std::sqrt(dx * dx + dy * dy);
            const double error = length - std::clamp(length, c.shortest, c.longest);
            if (!(std::fabs(error) > 0.0)) continue;
            const double impulse = length > 0.0 ? -mass * error / length : 0.0;
            foot.x[n] += c.foot_inverse_mass * impulse * dx;
            foot.y[n] += c.foot_inverse_mass * impulse * dy;
            g.trunk.x[n] -= c.trunk_inverse_mass * impulse * dx;
            g.trunk.y[n] -= c.trunk_inverse_mass * impulse * dy;
            done &= std::fabs(error) < kSlop;
        }
        if (done) break;
    }
    for (int i = 0; i < kLegs && c.arc.rolls; ++i) g.leg[i].foot.y[n] += s.leg[i].lift[n];
}

}  // namespace romgrl
