// Placing, saving and restoring a Walker.
#include "rom/box2d/physics.hpp"

namespace romgrl {
namespace {

b2Vec2 vector(double x, double y) { return {static_cast<float>(x), static_cast<float>(y)}; }

void set_body(b2Body* body, const double* state) {
    body->SetTransform(vector(state[0], state[1]), static_cast<float>(state[2]));
    body->SetLinearVelocity(vector(state[3], state[4]));
    body->SetAngularVelocity(static_cast<float>(state[5]));
}

void get_body(const b2Body* body, double* state) {
    state[0] = body->GetPosition().x;
    state[1] = body->GetPosition().y;
    state[2] = body->GetAngle();
    state[3] = body->GetLinearVelocity().x;
    state[4] = body->GetLinearVelocity().y;
    state[5] = body->GetAngularVelocity();
}

}  // namespace

void Walker::place(const double* state) {
    restore(state);
    ground_force_.fill(0.0);
    hip_torque_.fill(0.0);
}

void Walker::save(double* state) const {
    get_body(trunk_, state);
    get_body(feet_[0], state + 6);
    get_body(feet_[1], state + 12);
    state[18] = slot_[0];
    state[19] = origin_;
    state[20] = last_touchdown_x_;
    state[21] = last_touchdown_side_;
    state[22] = stiffness_share_;
    state[23] = touchdown_age_;
    for (int i = 0; i < kLegs; ++i) {
        double* motion = state + kMotion + kLegMotion * i;
        motion[0] = motion_[i].torque;
        motion[1] = motion_[i].shortening;
        motion[2] = motion_[i].touchdown_angle;
        motion[3] = motion_[i].airborne ? 1.0 : 0.0;
        motion[4] = motion_[i].extension;
        motion[5] = motion_[i].extension_rate;
        motion[6] = motion_[i].drive;
    }
}

void Walker::restore(const double* state) {
    set_body(trunk_, state);
    set_body(feet_[0], state + 6);
    set_body(feet_[1], state + 12);
    slot_ = {static_cast<int>(state[18]), 1 - static_cast<int>(state[18])};
    origin_ = state[19];
    last_touchdown_x_ = state[20];
    last_touchdown_side_ = static_cast<int>(state[21]);
    stiffness_share_ = state[22];
    touchdown_age_ = state[23];
    for (int i = 0; i < kLegs; ++i) {
        const double* motion = state + kMotion + kLegMotion * i;
        motion_[i] = Motion{motion[0], motion[1], motion[2], motion[3] != 0.0, motion[4], motion[5], motion[6]};
    }
}

}  // namespace romgrl
