// The contact of one foot with the ground in closed form, of one lane: on a circle about the leg's end, and of a foot that
// rolls. What passes a stop of the leg's length, or is too deep, is left to stops.cpp.
#pragma once

#include "rom/native/leg.hpp"

namespace romgrl {

// Velocities of a foot: forces, then the contact; tells if the leg passes one of its stops on either.
ROMGRL_INLINE bool move_foot(const NativeConstants& c, const Body& trunk, LegLanes& lanes, LegScratch& s,
                             const Leg& leg, double fx, double fy, int n) {
    const double vx = lanes.foot.vx[n] + c.dt * c.foot_inverse_mass * fx;
    const double vy = lanes.foot.vy[n] + c.dt * c.foot_inverse_mass * fy - c.foot_fall;
    const double normal = leg.contact ? larger(-vy, 0.0) : 0.0;  // impulses per foot mass
    const double grip = c.friction * normal;
    const double held_vx = vx + clamped(-vx, -grip, grip), held_vy = vy + normal;
    const double along = leg.along_x * trunk.vx[n] + leg.along_y * trunk.vy[n];
    const double before = leg.length + c.dt * (leg.along_x * vx + leg.along_y * vy - along);
    const double after = leg.length + c.dt * (leg.along_x * held_vx + leg.along_y * held_vy - along);
    lanes.foot.vx[n] = held_vx;
    lanes.foot.vy[n] = held_vy;
    lanes.ground_impulse[n] += normal;
    s.free_vx[n] = vx;
    s.free_vy[n] = vy;
    s.along_x[n] = leg.along_x;
    s.along_y[n] = leg.along_y;
    s.length[n] = leg.length;
    s.contact[n] = leg.contact ? 1.0 : 0.0;
    return (smaller(before, after) < c.shortest) | (larger(before, after) > c.longest);
}

// The same where feet roll: the trunk moves, too, so that the stops come after both feet. Each meets the trunk as it was
// before both (what is missing comes in the next substep). Returns the change of the trunk's velocity against t.
ROMGRL_INLINE double roll_foot(const NativeConstants& c, const Body& trunk, LegLanes& lanes, LegScratch& s, const Leg& leg,
                             double fx, double fy, int n) {
    const double vx = lanes.foot.vx[n] + c.dt * c.foot_inverse_mass * fx;
    const double vy = lanes.foot.vy[n] + c.dt * c.foot_inverse_mass * fy - c.foot_fall;
    const double across = leg.along_x * (vy - trunk.vy[n]) - leg.along_y * (vx - trunk.vx[n]);
    const ArcImpulse given = arc_impulse(c.arc, leg.along_x, leg.along_y, leg.inverse_lever, leg.contact, vx, vy, across);
    const double turn_x = -given.across * leg.along_y, turn_y = given.across * leg.along_x;
    lanes.foot.vx[n] = vx + given.tangent + turn_x;
    lanes.foot.vy[n] = vy + given.normal + turn_y;
    lanes.ground_impulse[n] += given.normal;
    s.along_x[n] = leg.along_x;
    s.along_y[n] = leg.along_y;
    s.length[n] = leg.length;
    s.lift[n] = lift(c.arc.touch(leg.along_y) - lanes.foot.y[n]);
    return c.arc.mass_ratio * given.across;
}

ROMGRL_INLINE bool passes_stop(const NativeConstants& c, const Body& trunk, const Body& foot, const Leg& leg, int n) {
    const double rate = leg.along_x * (foot.vx[n] - trunk.vx[n]) + leg.along_y * (foot.vy[n] - trunk.vy[n]);
    const double length = leg.length + c.dt * rate;
    return (length < c.shortest) | (length > c.longest);
}

// Tells if the position of this foot needs more than the one correction that it got.
ROMGRL_INLINE bool place_foot(const NativeConstants& c, const Body& trunk, Body& foot, LegScratch& s, int n) {
    foot.x[n] += c.dt * foot.vx[n];
    const double y = foot.y[n] + c.dt * foot.vy[n];
    s.free_y[n] = y;
    const double below = c.foot_radius - y;
    foot.y[n] = y + s.contact[n] * lift(below);
    const double dx = foot.x[n] - trunk.x[n], dy = foot.y[n] - trunk.y[n];
    const double square = dx * dx + dy * dy;
    return (s.contact[n] * below > 3.0 * kSlop) | (square < c.shortest * c.shortest) | (square > c.longest * c.longest);
}

// The same where feet roll, whose corrections come after the stops.
ROMGRL_INLINE bool place_rolling_foot(const NativeConstants& c, const Body& trunk, Body& foot, LegScratch& s, int n) {
    foot.x[n] += c.dt * foot.vx[n];
    const double y = foot.y[n] + c.dt * foot.vy[n];
    s.free_y[n] = y;
    foot.y[n] = y + s.lift[n];
    const double dx = foot.x[n] - trunk.x[n], dy = y - trunk.y[n], square = dx * dx + dy * dy;
    return (square < c.shortest * c.shortest) | (square > c.longest * c.longest);
}

}  // namespace romgrl
