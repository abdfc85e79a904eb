#include "rom/box2d/physics.hpp"

#include <algorithm>
#include <cmath>

namespace romgrl {
namespace {

constexpr float kGroundHalfLength = 128.0F;  // m; the bodies stay near Box2D's origin, where float32 is fine
constexpr double kLargestForce = 1e12;

void add_ground(b2World& world, double friction) {
    b2BodyDef definition;
    b2Body* ground = world.CreateBody(&definition);
    b2EdgeShape edge;
    // Edges carry a skin of b2_polygonRadius: lowered by it, the surface is y = 0.
    edge.SetTwoSided({-kGroundHalfLength, -b2_polygonRadius}, {kGroundHalfLength, -b2_polygonRadius});
    b2FixtureDef fixture;
    fixture.shape = &edge;
    fixture.friction = static_cast<float>(friction);
    ground->CreateFixture(&fixture);
}

b2Body* add_body(b2World& world, bool pinned, bool fixed_rotation) {
    b2BodyDef definition;
    definition.type = pinned ? b2_staticBody : b2_dynamicBody;
    definition.fixedRotation = fixed_rotation;
    definition.allowSleep = false;
    definition.position.Set(0.0F, 1.0F);
    return world.CreateBody(&definition);
}

void add_circle(b2Body* foot, const Parameters& parameters) {
    b2CircleShape circle;
    circle.m_radius = static_cast<float>(parameters.foot_radius);
    b2FixtureDef fixture;
    fixture.shape = &circle;
    fixture.friction = static_cast<float>(parameters.friction);
    fixture.filter.groupIndex = -1;  // feet pass each other
    foot->CreateFixture(&fixture);
}

void set_mass(b2Body* body, double mass, double inertia) {
    b2MassData data;
    data.mass = static_cast<float>(mass);
    data.center.SetZero();
    data.I = static_cast<float>(inertia);
    body->SetMassData(&data);
}

b2Vec2 vector(double x, double y) { return {static_cast<float>(x), static_cast<float>(y)}; }

bool sane_body(const b2Body* body) {  // false for NaN
    const b2Vec2& p = body->GetPosition();
    const b2Vec2& v = body->GetLinearVelocity();
    const double position = std::fabs(p.x) + std::fabs(p.y) + std::fabs(body->GetAngle());
    const double velocity = std::fabs(v.x) + std::fabs(v.y) + std::fabs(body->GetAngularVelocity());
    return position < kLargestPosition && velocity < kLargestVelocity;
}

}  // namespace

Walker::Walker(const Parameters& parameters)
    : parameters_(parameters),
      motor_(parameters),
      arc_(parameters),
      dt_(parameters.substep_time()),
      lag_gain_(parameters.torque_lag > 0.0 ? -std::expm1(-dt_ / parameters.torque_lag) : 1.0),
      world_(vector(0.0, -parameters.gravity)) {
    world_.SetAllowSleeping(false);
    world_.SetContinuousPhysics(false);
    // Without warm starting a step depends on positions and velocities alone, so that a saved state is exact.
    world_.SetWarmStarting(false);
    add_ground(world_, parameters.friction);
    trunk_ = add_body(world_, parameters.trunk_pinned, parameters.trunk_locked);
    set_mass(trunk_, parameters.mass - kLegs * parameters.foot_mass, parameters.trunk_inertia);
    for (int i = 0; i < kLegs; ++i) {
        feet_[i] = add_body(world_, false, true);
        if (!arc_.rolls) add_circle(feet_[i], parameters);
        set_mass(feet_[i], parameters.foot_mass, 0.0);
        b2DistanceJointDef joint;
        joint.bodyA = trunk_;
        joint.bodyB = feet_[i];
        joint.length = static_cast<float>(parameters.leg_length);
        joint.minLength = static_cast<float>(parameters.compression_limit * parameters.leg_length);
        joint.maxLength = static_cast<float>(parameters.extension_limit * parameters.leg_length);
        stops_[i] = static_cast<b2DistanceJoint*>(world_.CreateJoint(&joint));
    }
}

LegView Walker::leg(int side) const {
    const b2Body* body = foot(side);
    const b2Vec2 d = body->GetPosition() - trunk_->GetPosition();
    const b2Vec2 v = body->GetLinearVelocity() - trunk_->GetLinearVelocity();
    LegView view{};
    view.length = std::sqrt(double(d.x) * d.x + double(d.y) * d.y);
    view.along_x = view.length > 0.0 ? d.x / view.length : 0.0;
    view.along_y = view.length > 0.0 ? d.y / view.length : -1.0;
    view.rate = view.along_x * v.x + view.along_y * v.y;
    view.angle = std::atan2(view.along_x, -view.along_y);
    const double lever = std::max(view.length, kShortestLever * parameters_.leg_length);
    view.angle_rate = (-view.along_y * v.x + view.along_x * v.y) / lever;
    view.height = body->GetPosition().y;
    view.contact = body->GetPosition().y <= static_cast<float>(arc_.touch(view.along_y));
    return view;
}

bool Walker::loaded(int side, const LegView& view) const { return view.contact && view.length < rest_length(side); }

double Walker::axial_force(int side, const LegView& view) const {
    const double damping = loaded(side, view) ? parameters_.stance_damping : parameters_.swing_damping;
    const double rate = view.rate - motion_[side].extension_rate;  // the damper is beside the spring
    return parameters_.stiffness * stiffness_share_ * (rest_length(side) - view.length) - damping * rate;
}

// Moves the carriage of a leg's motor against the axial force; adds its work.
void Walker::update_motor(int side, double drive, double axial) {
    Motion& motion = motion_[side];
    motion.drive += motor_.lag_gain * (drive - motion.drive);
    const Carriage moved = move_carriage(motor_, motion.drive, motion.extension, motion.extension_rate, axial);
    motion.extension = moved.extension;
    motion.extension_rate = moved.rate;
    work_.leg_motor += std::fabs(moved.work);
    work_.positive_leg_motor += std::max(moved.work, 0.0);
}

// True at a touchdown: the first load after leaving the ground.
bool Walker::update_touchdown(int side, const LegView& view, bool is_loaded) {
    Motion& motion = motion_[side];
    if (!view.contact) motion.airborne = true;
    if (!motion.airborne || !is_loaded) return false;
    motion.airborne = false;
    motion.touchdown_angle = view.angle;
    return true;
}

// An unloaded leg shortens while the other one carries the body, until it has passed half of its last touchdown angle;
// then it extends again. A loaded leg keeps its rest length: extending it would pump energy into the stance (up to
// k (0.15 L0)^2 / 2 = 200 J per step), which makes a two-legged hop the best gait. Returns the work that it takes: what
// the spring, whose length stays, holds more than before, k ((r' - l)^2 - (r - l)^2) / 2.
double Walker::update_shortening(int side, const LegView& view, bool other_loaded) {
    Motion& motion = motion_[side];
    const bool early = other_loaded && view.angle < 0.5 * std::max(motion.touchdown_angle, 0.0);
    const double full = parameters_.retraction * parameters_.leg_length;
    const double change = full * dt_ / parameters_.retraction_time;
    const double target = early ? full : 0.0;
    const double compression = rest_length(side) - view.length;
    const double shortened = std::clamp(target - motion.shortening, -change, change);
    motion.shortening += shortened;
    return -parameters_.stiffness * stiffness_share_ * shortened * (compression - 0.5 * shortened);
}

// Hip stops: a critically damped spring whose period is a fixed number of substeps, as torque on the leg. It only pushes
// back. The effective inertia is that of a foot on a massless leg.
double Walker::stop_torque(const LegView& view) const {
    const double angle = view.angle + pitch();
    const double excess = std::fabs(angle) - parameters_.hip_angle_limit;
    if (excess <= 0.0) return 0.0;
    const double side = angle > 0.0 ? 1.0 : -1.0;
    const double frequency = kHipStopFrequency / dt_;
    const double rate = side * (view.angle_rate + pitch_rate());
    const double acceleration = frequency * frequency * excess + 2.0 * frequency * rate;
    return -side * parameters_.foot_mass * view.length * view.length * std::max(acceleration, 0.0);
}

bool Walker::substep(const std::array<double, kLegs>& asked, const std::array<double, kLegs>& drive) {
    std::array<LegView, kLegs> view{};
    std::array<bool, kLegs> is_loaded{};
    std::array<double, kLegs> wound{};
    int touchdown = 0;
    for (int i = 0; i < kLegs; ++i) {
        view[i] = leg(i);
        is_loaded[i] = loaded(i, view[i]);
    }
    for (int i = 0; i < kLegs; ++i) {
        if (update_touchdown(i, view[i], is_loaded[i])) touchdown += i == 0 ? 1 : 2;
        if (!is_loaded[i]) wound[i] = update_shortening(i, view[i], is_loaded[1 - i]);
        motion_[i].torque += lag_gain_ * (asked[i] - motion_[i].torque);
    }
    if (touchdown == 3) touchdown = view[0].angle > view[1].angle ? 1 : 2;  // both at once: the one in front
    touchdown_age_ = touchdown == 0 ? touchdown_age_ + dt_ : 0.0;
    if (touchdown != 0) {
        last_touchdown_side_ = touchdown == 1 ? 1 : -1;
        last_touchdown_x_ = x();
    }
    work_.retraction += std::fabs(wound[0]) + std::fabs(wound[1]);
    work_.positive_retraction += std::max(wound[0], 0.0) + std::max(wound[1], 0.0);
    const double net = motion_[0].torque + motion_[1].torque;
    const double limit = parameters_.trunk_moment_limit;
    const double excess = net - std::clamp(net, -limit, limit);
    std::array<double, kLegs> fx{}, fy{}, torque{};
    for (int i = 0; i < kLegs; ++i) {
        hip_torque_[i] = motion_[i].torque - 0.5 * excess;
        torque[i] = hip_torque_[i] + stop_torque(view[i]);
        const double axial = axial_force(i, view[i]);
        const double across = torque[i] / std::max(view[i].length, kShortestLever * parameters_.leg_length);
        fx[i] = axial * view[i].along_x - across * view[i].along_y;
        fy[i] = axial * view[i].along_y + across * view[i].along_x;
        if (!(std::fabs(fx[i]) < kLargestForce && std::fabs(fy[i]) < kLargestForce)) return false;
        if (parameters_.leg_motor) update_motor(i, drive[i], axial);
    }
    for (int i = 0; i < kLegs; ++i) foot(i)->ApplyForceToCenter(vector(fx[i], fy[i]), true);
    trunk_->ApplyForceToCenter(vector(-(fx[0] + fx[1]), -(fy[0] + fy[1])), true);
    trunk_->ApplyTorque(static_cast<float>(-(torque[0] + torque[1])), true);
    if (arc_.rolls) roll_feet(view, {vector(fx[0], fy[0]), vector(fx[1], fy[1])});
    for (b2DistanceJoint* stop : stops_) {  // setting a limit clears its impulse, which Box2D would carry over
        stop->SetMinLength(stop->GetMinLength());
        stop->SetMaxLength(stop->GetMaxLength());
    }
    const double turning = pitch_rate();
    world_.Step(static_cast<float>(dt_), parameters_.velocity_iterations, parameters_.position_iterations);
    arc_.rolls ? lift_feet(view) : add_ground_force();
    if (!sane()) return false;
    add_hip_work(view, turning);
    recentre();
    return true;
}

// Box2D has no body that turns with a leg without mass: the ground's impulses on the feet are given before the step, to
// bodies that have the velocities that the forces will give them. The length stops come after.
void Walker::roll_feet(const std::array<LegView, kLegs>& view, const std::array<b2Vec2, kLegs>& force) {
    const double trunk_mass = trunk_->GetMass(), pulled = trunk_mass > 0.0 ? dt_ / trunk_mass : 0.0;  // 0: held
    const double fall = dt_ * parameters_.gravity;
    const double trunk_vx = vx() - pulled * (force[0].x + force[1].x);
    const double trunk_vy = vy() - pulled * (force[0].y + force[1].y) - (trunk_mass > 0.0 ? fall : 0.0);
    for (int slot = 0; slot < kLegs; ++slot) {  // a mirrored world adds in the mirrored order
        const int side = slot_[0] == slot ? 0 : 1;
        const LegView& leg = view[side];
        if (!leg.contact) continue;
        const b2Vec2& v = foot(side)->GetLinearVelocity();
        const double foot_vx = v.x + dt_ * force[side].x / parameters_.foot_mass;
        const double foot_vy = v.y + dt_ * force[side].y / parameters_.foot_mass - fall;
        const double across = leg.along_x * (foot_vy - trunk_vy) - leg.along_y * (foot_vx - trunk_vx);
        const double lever = std::max(leg.length, kShortestLever * parameters_.leg_length);
        const ArcImpulse given = arc_impulse(arc_, leg.along_x, leg.along_y, 1.0 / lever, true, foot_vx, foot_vy, across);
        const double mass = parameters_.foot_mass, turning = mass * given.across;
        foot(side)->ApplyLinearImpulseToCenter(
            vector(mass * given.tangent - turning * leg.along_y, mass * given.normal + turning * leg.along_x), true);
        trunk_->ApplyLinearImpulseToCenter(vector(turning * leg.along_y, -turning * leg.along_x), true);
        ground_force_[side] += mass * given.normal / (dt_ * parameters_.substeps);
    }
}

void Walker::lift_feet(const std::array<LegView, kLegs>& before) {
    for (int i = 0; i < kLegs; ++i) {
        const double up = lift(arc_.touch(before[i].along_y) - before[i].height);
        const b2Vec2 p = foot(i)->GetPosition();
        if (up > 0.0) foot(i)->SetTransform({p.x, static_cast<float>(p.y + up)}, 0.0F);
    }
}

void Walker::add_ground_force() {
    for (int i = 0; i < kLegs; ++i) {
        for (b2ContactEdge* edge = foot(i)->GetContactList(); edge != nullptr; edge = edge->next) {
            if (!edge->contact->IsTouching()) continue;
            const double impulse = edge->contact->GetManifold()->points[0].normalImpulse;
            ground_force_[i] += impulse / (dt_ * parameters_.substeps);
        }
    }
}

// Torque times the mean of the hip's rate before and after the substep, along the direction in which the torque acted: its
// work on the bodies exactly, impacts in the same substep or not.
void Walker::add_hip_work(const std::array<LegView, kLegs>& before, double pitch_rate_before) {
    std::array<double, kLegs> done{};
    for (int i = 0; i < kLegs; ++i) {
        const b2Vec2 v = foot(i)->GetLinearVelocity() - trunk_->GetLinearVelocity();
        const double lever = std::max(before[i].length, kShortestLever * parameters_.leg_length);
        const double after = (-before[i].along_y * v.x + before[i].along_x * v.y) / lever + pitch_rate();
        done[i] = hip_torque_[i] * 0.5 * (before[i].angle_rate + pitch_rate_before + after) * dt_;
    }
    work_.hip += std::fabs(done[0]) + std::fabs(done[1]);
    work_.positive_hip += std::max(done[0], 0.0) + std::max(done[1], 0.0);
}

bool Walker::step(const std::array<double, kLegs>& asked, const std::array<double, kLegs>& drive) {
    ground_force_.fill(0.0);
    work_ = Work{};
    for (int i = 0; i < parameters_.substeps; ++i) {
        if (!substep(asked, drive)) return false;
    }
    return true;
}

bool Walker::sane() const {
    return sane_body(trunk_) && sane_body(feet_[0]) && sane_body(feet_[1]) &&
           std::fabs(motion_[0].extension_rate) < kLargestVelocity && std::fabs(motion_[1].extension_rate) < kLargestVelocity;
}

void Walker::recentre() {
    const double shift = kShift * std::trunc(trunk_->GetPosition().x / kShift);
    if (shift == 0.0) return;
    origin_ += shift;
    for (b2Body* body : {trunk_, feet_[0], feet_[1]}) {
        const b2Vec2 p = body->GetPosition();
        body->SetTransform({static_cast<float>(p.x - shift), p.y}, body->GetAngle());
    }
}

}  // namespace romgrl
