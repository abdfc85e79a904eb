// Loops over lanes that the compiler turns into vector instructions. No contraction into fused multiply-adds (see
// CMakeLists.txt): every instruction set gives the same bits.
#include <cmath>

#include "rom/native/contact.hpp"
#include "rom/native/leg.hpp"
#include "rom/native/native.hpp"

// One copy of a function per instruction set, chosen when the module is loaded.
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define ROMGRL_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define ROMGRL_CLONES
#endif

namespace romgrl {
namespace {

// The damper is beside the spring, so that it moves with the rest length.
ROMGRL_INLINE double axial_force(const NativeConstants& c, const Leg& leg, double stiffness, double rest, double rest_rate,
                                 bool loaded) {
    return stiffness * (rest - leg.length) - (loaded ? c.stance_damping : c.swing_damping) * (leg.rate - rest_rate);
}

// Without a motor the extension is zero, which changes no bit.
ROMGRL_INLINE double rest_of(const NativeConstants& c, const LegLanes& lanes, int n) {
    return c.leg_length - lanes.shortening[n] + lanes.extension[n];
}

// Moves the carriage of a leg's motor against the axial force; adds its work.
ROMGRL_INLINE void update_motor(const NativeConstants& c, LegLanes& lanes, double asked, double axial, WorkLanes& work,
                                int n) {
    const double drive = lanes.drive[n] + c.motor.lag_gain * (asked - lanes.drive[n]);
    const Carriage moved = move_carriage(c.motor, drive, lanes.extension[n], lanes.extension_rate[n], axial);
    lanes.drive[n] = drive;
    lanes.extension[n] = moved.extension;
    lanes.extension_rate[n] = moved.rate;
    work.leg_motor[n] += std::fabs(moved.work);
    work.positive_leg_motor[n] += larger(moved.work, 0.0);
}

// 1 at a touchdown: the first load after leaving the ground.
ROMGRL_INLINE double update_touchdown(LegLanes& lanes, const Leg& leg, bool loaded, int n) {
    const double was_airborne = lanes.airborne[n], old_angle = lanes.touchdown_angle[n];
    const double airborne = leg.contact ? was_airborne : 1.0;
    const bool touchdown = (airborne > 0.0) & loaded;
    lanes.airborne[n] = touchdown ? 0.0 : airborne;
    lanes.touchdown_angle[n] = touchdown ? leg.angle : old_angle;
    return touchdown ? 1.0 : 0.0;
}

// See Walker::update_shortening. Returns the change.
ROMGRL_INLINE double update_shortening(const NativeConstants& c, LegLanes& lanes, const Leg& leg, bool loaded,
                                     bool other_loaded, int n) {
    const bool early = other_loaded & (leg.angle < 0.5 * larger(lanes.touchdown_angle[n], 0.0));
    const double old = lanes.shortening[n];
    const double missing = (early ? c.retraction : 0.0) - old;
    const double change = loaded ? 0.0 : clamped(missing, -c.retraction_change, c.retraction_change);
    lanes.shortening[n] = old + change;
    return change;
}

// See Walker::stop_torque.
ROMGRL_INLINE double stop_torque(const NativeConstants& c, const Leg& leg, double angle, double rate) {
    const double hip = leg.angle - angle;
    const double excess = std::fabs(hip) - c.hip_angle_limit;
    const double outward = std::copysign(1.0, hip) * (leg.angle_rate - rate);
    const double push = larger(c.stop_stiffness * excess + c.stop_damping * outward, 0.0);
    return excess > 0.0 ? std::copysign(push * leg.length * leg.length, -hip) : 0.0;
}

// See Walker::update_shortening: per stiffness.
ROMGRL_INLINE double retraction_work(const Leg& leg, double rest, double shortened) {
    return -shortened * (rest - leg.length + 0.5 * shortened);
}

// See Walker::add_hip_work: per half a substep's time.
ROMGRL_INLINE double hip_work(const Group& g, const LegLanes& lanes, const Leg& leg, double rate, int n) {
    const double vx = lanes.foot.vx[n] - g.trunk.vx[n], vy = lanes.foot.vy[n] - g.trunk.vy[n];
    const double after = (leg.along_x * vy - leg.along_y * vx) * leg.inverse_lever - g.rate[n];
    return lanes.hip_torque[n] * (rate + after);
}

template <bool kMotor, bool kRolls>
ROMGRL_INLINE void update_velocities(const NativeConstants& c, const Actuation& asked, Group& g, Scratch& s,
                                     WorkLanes& work, int n) {
    LegLanes &p = g.leg[0], &q = g.leg[1];
    const Leg a = look(c, g, p.foot, n), b = look(c, g, q.foot, n);
    const bool a_loaded = a.contact & (a.length < rest_of(c, p, n)), b_loaded = b.contact & (b.length < rest_of(c, q, n));
    const double a_down = update_touchdown(p, a, a_loaded, n), b_down = update_touchdown(q, b, b_loaded, n);
    const double a_shortened = update_shortening(c, p, a, a_loaded, b_loaded, n);
    const double b_shortened = update_shortening(c, q, b, b_loaded, a_loaded, n);
    // 1: a touched down, -1: b did; both at once: the one in front.
    const double which = a_down - b_down + a_down * b_down * (a.angle > b.angle ? 1.0 : -1.0);
    const double side = which * (1.0 - 2.0 * g.left_slot[n]), at_x = g.origin[n] + g.trunk.x[n];
    const double old_side = g.touchdown_side[n], old_x = g.touchdown_x[n], age = g.touchdown_age[n] + c.dt;
    g.touchdown_side[n] = which * which > 0.0 ? side : old_side;
    g.touchdown_x[n] = which * which > 0.0 ? at_x : old_x;
    g.touchdown_age[n] = which * which > 0.0 ? 0.0 : age;

    p.torque[n] += c.lag_gain * (asked.torque[0][n] - p.torque[n]);
    q.torque[n] += c.lag_gain * (asked.torque[1][n] - q.torque[n]);
    const double net = p.torque[n] + q.torque[n];
    const double excess = net - clamped(net, -c.moment_limit, c.moment_limit);
    p.hip_torque[n] = p.torque[n] - 0.5 * excess;
    q.hip_torque[n] = q.torque[n] - 0.5 * excess;
    const double a_torque = p.hip_torque[n] + stop_torque(c, a, g.angle[n], g.rate[n]);
    const double b_torque = q.hip_torque[n] + stop_torque(c, b, g.angle[n], g.rate[n]);

    const double a_rate = a.angle_rate - g.rate[n], b_rate = b.angle_rate - g.rate[n];

    const double a_rest = rest_of(c, p, n), b_rest = rest_of(c, q, n), stiffness = c.stiffness * g.stiffness_share[n];
    const double a_wound = retraction_work(a, a_rest, a_shortened), b_wound = retraction_work(b, b_rest, b_shortened);
    const double a_axial = axial_force(c, a, stiffness, a_rest, p.extension_rate[n], a.contact & (a.length < a_rest));
    const double b_axial = axial_force(c, b, stiffness, b_rest, q.extension_rate[n], b.contact & (b.length < b_rest));
    const double a_across = a_torque * a.inverse_lever, b_across = b_torque * b.inverse_lever;
    const double a_fx = a_axial * a.along_x - a_across * a.along_y, a_fy = a_axial * a.along_y + a_across * a.along_x;
    const double b_fx = b_axial * b.along_x - b_across * b.along_y, b_fy = b_axial * b.along_y + b_across * b.along_x;
    g.trunk.vx[n] -= c.dt * c.trunk_inverse_mass * (a_fx + b_fx);
    g.trunk.vy[n] -= c.dt * c.trunk_inverse_mass * (a_fy + b_fy) + c.trunk_fall;
    g.rate[n] -= c.dt * c.trunk_inverse_inertia * (a_torque + b_torque);
    if (kMotor) {
        update_motor(c, p, asked.drive[0][n], a_axial, work, n);
        update_motor(c, q, asked.drive[1][n], b_axial, work, n);
    }
    if (kRolls) {
        const double a_back = roll_foot(c, g.trunk, p, s.leg[0], a, a_fx, a_fy, n);
        const double b_back = roll_foot(c, g.trunk, q, s.leg[1], b, b_fx, b_fy, n);
        g.trunk.vx[n] += a_back * a.along_y + b_back * b.along_y;
        g.trunk.vy[n] -= a_back * a.along_x + b_back * b.along_x;
        s.stopped[n] = (passes_stop(c, g.trunk, p.foot, a, n) | passes_stop(c, g.trunk, q.foot, b, n)) ? 1.0 : 0.0;
    } else {
        const bool a_stop = move_foot(c, g.trunk, p, s.leg[0], a, a_fx, a_fy, n);
        const bool b_stop = move_foot(c, g.trunk, q, s.leg[1], b, b_fx, b_fy, n);
        s.stopped[n] = (a_stop | b_stop) ? 1.0 : 0.0;
    }

    const double a_done = hip_work(g, p, a, a_rate, n), b_done = hip_work(g, q, b, b_rate, n);
    s.leg[0].hip_work[n] = a_done;
    s.leg[1].hip_work[n] = b_done;
    work.hip[n] += std::fabs(a_done) + std::fabs(b_done);
    work.positive_hip[n] += larger(a_done, 0.0) + larger(b_done, 0.0);
    work.retraction[n] += std::fabs(a_wound) + std::fabs(b_wound);
    work.positive_retraction[n] += larger(a_wound, 0.0) + larger(b_wound, 0.0);
}

// The same for one lane at its stops, and what that changes of the hips' work.
void stop(const NativeConstants& c, const Scratch& s, int n, Group& g, WorkLanes& work) {
    const auto across = [&](int i) {
        const Body& foot = g.leg[i].foot;
        return s.leg[i].along_x[n] * (foot.vy[n] - g.trunk.vy[n]) - s.leg[i].along_y[n] * (foot.vx[n] - g.trunk.vx[n]);
    };
    const double before[kLegs] = {across(0), across(1)};
    solve_velocities(c, s, n, g);
    double change = 0.0, positive_change = 0.0;
    for (int i = 0; i < kLegs; ++i) {
        const double inverse_lever = smaller(1.0 / larger(s.leg[i].length[n], 1e-30), c.inverse_shortest_lever);
        const double old = s.leg[i].hip_work[n];
        const double done = old + g.leg[i].hip_torque[n] * (across(i) - before[i]) * inverse_lever;
        change += std::fabs(done) - std::fabs(old);
        positive_change += larger(done, 0.0) - larger(old, 0.0);
    }
    work.hip[n] += change;
    work.positive_hip[n] += positive_change;
}

template <bool kRolls>
ROMGRL_INLINE void update_positions(const NativeConstants& c, Group& g, Scratch& s, int n) {
    g.trunk.x[n] += c.dt * g.trunk.vx[n];
    g.trunk.y[n] += c.dt * g.trunk.vy[n];
    g.angle[n] += c.dt * g.rate[n];
    Body &a = g.leg[0].foot, &b = g.leg[1].foot;
    const bool a_stop = kRolls ? place_rolling_foot(c, g.trunk, a, s.leg[0], n) : place_foot(c, g.trunk, a, s.leg[0], n);
    const bool b_stop = kRolls ? place_rolling_foot(c, g.trunk, b, s.leg[1], n) : place_foot(c, g.trunk, b, s.leg[1], n);
    s.stopped[n] = (a_stop | b_stop) ? 1.0 : 0.0;
}

ROMGRL_INLINE bool any(const Lanes& flags) {
    double sum = 0.0;
    for (int n = 0; n < kLanes; ++n) sum += flags[n];
    return sum > 0.0;
}

ROMGRL_INLINE void recentre(Group& g) {
    for (int n = 0; n < kLanes; ++n) {
        const double shift = kShift * static_cast<double>(static_cast<int>(g.trunk.x[n] * (1.0 / kShift)));
        g.origin[n] += shift;
        g.trunk.x[n] -= shift;
        g.leg[0].foot.x[n] -= shift;
        g.leg[1].foot.x[n] -= shift;
    }
}

template <bool kMotor, bool kRolls>
ROMGRL_INLINE void substeps(const NativeConstants& c, const Actuation& asked, Group& group, Scratch& scratch, WorkLanes& done) {
    for (int substep = 0; substep < c.substeps; ++substep) {
        for (int n = 0; n < kLanes; ++n) update_velocities<kMotor, kRolls>(c, asked, group, scratch, done, n);
        if (any(scratch.stopped)) {
            for (int n = 0; n < kLanes; ++n) {
                if (scratch.stopped[n] > 0.0) stop(c, scratch, n, group, done);
            }
        }
        for (int n = 0; n < kLanes; ++n) update_positions<kRolls>(c, group, scratch, n);
        if (any(scratch.stopped)) {
            for (int n = 0; n < kLanes; ++n) {
                if (scratch.stopped[n] > 0.0) solve_positions(c, scratch, n, group);
            }
        }
    }
}

}  // namespace

ROMGRL_CLONES void native_step(const NativeConstants& constants, const Actuation& asked, Group& group,
                               WorkLanes& work) {
    const NativeConstants c = constants;
    Scratch scratch;
    WorkLanes done{};
    group.leg[0].ground_impulse = group.leg[1].ground_impulse = Lanes{};
    if (c.has_motor) {
        c.arc.rolls ? substeps<true, true>(c, asked, group, scratch, done)
                    : substeps<true, false>(c, asked, group, scratch, done);
    } else {
        c.arc.rolls ? substeps<false, true>(c, asked, group, scratch, done)
                    : substeps<false, false>(c, asked, group, scratch, done);
    }
    recentre(group);
    for (int n = 0; n < kLanes; ++n) {
        work.hip[n] = 0.5 * c.dt * done.hip[n];
        work.positive_hip[n] = 0.5 * c.dt * done.positive_hip[n];
        const double stiffness = c.stiffness * group.stiffness_share[n];
        work.retraction[n] = stiffness * done.retraction[n];
        work.positive_retraction[n] = stiffness * done.positive_retraction[n];
        work.leg_motor[n] = done.leg_motor[n];
        work.positive_leg_motor[n] = done.positive_leg_motor[n];
    }
}

ROMGRL_CLONES void native_view(const NativeConstants& c, const Group& group, View& view) {
    for (int i = 0; i < kLegs; ++i) {
        const LegLanes& lanes = group.leg[i];
        for (int n = 0; n < kLanes; ++n) {
            const Leg leg = look(c, group, lanes.foot, n);
            const double rest = rest_of(c, lanes, n), stiffness = c.stiffness * group.stiffness_share[n];
            const bool loaded = leg.contact & (leg.length < rest);
            view.length[i][n] = leg.length;
            view.rate[i][n] = leg.rate;
            view.angle[i][n] = leg.angle;
            view.angle_rate[i][n] = leg.angle_rate;
            view.x[i][n] = leg.length * leg.along_x;
            view.y[i][n] = leg.length * leg.along_y;
            view.load[i][n] = loaded ? axial_force(c, leg, stiffness, rest, lanes.extension_rate[n], loaded) : 0.0;
            view.contact[i][n] = leg.contact ? 1.0 : 0.0;
        }
    }
}

}  // namespace romgrl
