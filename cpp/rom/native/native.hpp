// The native engine: point masses on springs, integrated like Box2D integrates them, many worlds side by side in lanes.
//
// A foot is a point mass above a fixed flat ground, so that contact with friction has a closed form. The length stops of
// the legs and deep penetration couple the bodies; the few worlds where they are in play go through Box2D's iterations.
// Where feet roll, their contact comes before the stops, in both engines.
#pragma once

#include "rom/arc_foot.hpp"
#include "rom/leg_motor.hpp"
#include "rom/parameters.hpp"
#include "rom/world_state.hpp"

namespace romgrl {

constexpr int kLanes = 16;

struct alignas(64) Lanes {
    double at[kLanes];
    double& operator[](int lane) { return at[lane]; }
    double operator[](int lane) const { return at[lane]; }
};

struct Body {
    Lanes x, y, vx, vy;
};

// Legs are in slots, not left and right: see pose_state().
struct LegLanes {
    Body foot;
    Lanes torque, shortening, touchdown_angle, airborne;  // airborne: 1 if it left the ground since it was last loaded
    Lanes extension, extension_rate, drive;  // of the rest length, m, m/s; of the leg's motor
    Lanes ground_impulse, hip_torque;  // of the last control step, N s per foot mass; of the last substep, N m
};

struct Group {
    Body trunk;
    Lanes angle, rate;  // of the trunk, counter-clockwise
    Lanes origin, touchdown_x, touchdown_side, touchdown_age, left_slot;  // touchdown_age: s since the last one
    Lanes stiffness_share;
    LegLanes leg[kLegs];
};

// Per substep: what the stops need beside the group.
struct LegScratch {
    Lanes along_x, along_y, length;  // at the start of the substep
    Lanes free_vx, free_vy;  // of the foot after the forces, before contact
    Lanes free_y;  // of the foot before the correction of its position
    Lanes contact;  // 1: touched the ground at the start of the substep
    Lanes lift;  // of a foot that rolls, for how deep it was then, m
    Lanes hip_work;  // without the stops: J per half a substep's time
};

struct Scratch {
    LegScratch leg[kLegs];
    Lanes stopped;  // 1: a length stop or a deep contact is in play
};

struct NativeConstants {
    explicit NativeConstants(const Parameters& parameters);

    double dt, lag_gain, leg_length, foot_radius, inverse_shortest_lever;
    ArcFoot arc;
    double stiffness, stance_damping, swing_damping;
    double retraction, retraction_change;  // m; per substep
    double hip_angle_limit, stop_stiffness, stop_damping;  // of the hip stops, per m^2 of leg length
    double moment_limit, friction;
    double foot_inverse_mass, trunk_inverse_mass, trunk_inverse_inertia;
    LegMotor motor;
    bool has_motor;
    double foot_fall, trunk_fall;  // velocity that gravity adds per substep, m/s
    double shortest, longest;  // leg between its stops, m
    int substeps, velocity_iterations, position_iterations;
};

// See Work. While a step lasts, the hips' is per half a substep's time, the retraction's per stiffness.
struct WorkLanes {
    Lanes hip, positive_hip, retraction, positive_retraction, leg_motor, positive_leg_motor;
};

struct Actuation {
    Lanes torque[kLegs];  // N m
    Lanes drive[kLegs];  // of the legs' motors
};

// What an observation is made of, in SI units.
struct View {
    Lanes length[kLegs], rate[kLegs], angle[kLegs], angle_rate[kLegs], x[kLegs], y[kLegs];
    Lanes load[kLegs];  // spring and damper of a loaded leg, N
    Lanes contact[kLegs];  // 0 or 1
};

inline int slot_of(const Group& group, int lane, int side) { return group.left_slot[lane] > 0.0 ? 1 - side : side; }
bool sane(const Group& group, int lane);  // false: the state has diverged
void copy_lane(const Group& from, int lane, Group& to);
void put_lane(const double* state, bool pinned, int lane, Group& group);
void get_lane(const Group& group, int lane, double* state);

// One control step of all lanes.
void native_step(const NativeConstants& constants, const Actuation& asked, Group& group, WorkLanes& work);
void native_view(const NativeConstants& constants, const Group& group, View& view);

// Box2D's iterations for one lane, from the velocities after the forces, and from the positions after integration.
void solve_velocities(const NativeConstants& constants, const Scratch& scratch, int lane, Group& group);
void solve_positions(const NativeConstants& constants, const Scratch& scratch, int lane, Group& group);

}  // namespace romgrl
