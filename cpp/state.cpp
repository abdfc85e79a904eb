// Placing, saving and restoring a Walker.
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>

#include "physics.hpp"

namespace romgrl {
namespace {

constexpr double kLargestNumber = 1e3;  // m, m/s, rad, rad/s
constexpr double kFarthest = 16.0;  // m from Box2D's origin, within the ground

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

bool valid_body(const double* state) {
    const auto small = [](double value) { return std::fabs(value) < kLargestNumber; };
    return std::all_of(state, state + 6, small) && std::fabs(state[0]) < kFarthest;
}

bool valid(const double* state) {
    const auto finite = [](double value) { return std::isfinite(value); };
    return valid_body(state) && valid_body(state + 6) && valid_body(state + 12) &&
           std::all_of(state + 18, state + Walker::kStateSize, finite) && (state[18] == 0.0 || state[18] == 1.0) &&
           std::fabs(state[21]) <= 1.0;
}

}  // namespace

// Box2D solves the two legs one after the other. Which leg comes first follows from the pose and not from its name, so
// that a mirrored world is solved in the mirrored order and stays the mirror image bit for bit.
void Walker::place(const Pose& pose) {
    std::array<double, kStateSize> state{};
    const double trunk[6] = {0.0, pose.y, -pose.pitch, pose.vx, pose.vy, -pose.pitch_rate};
    std::copy(trunk, trunk + 6, state.begin());
    const auto key = [&pose](int i) {
        return std::make_tuple(pose.hip_angle[i], pose.hip_rate[i], pose.leg_length[i], pose.leg_rate[i]);
    };
    const int first = key(0) < key(1) ? 1 : 0;
    for (int i = 0; i < kLegs; ++i) {
        const double angle = pose.hip_angle[i] - pose.pitch, length = pose.leg_length[i];
        const double across = length * (pose.hip_rate[i] - pose.pitch_rate);
        const double s = std::sin(angle), c = std::cos(angle);
        double* foot = state.data() + (i == first ? 6 : 12);
        foot[0] = length * s;
        foot[1] = pose.y - length * c;
        foot[3] = pose.vx + pose.leg_rate[i] * s + across * c;
        foot[4] = pose.vy - pose.leg_rate[i] * c + across * s;
        if (!(length > 0.0)) throw std::invalid_argument("the pose has a leg of no length");
        state[24 + 4 * i] = std::fabs(angle);
        state[25 + 4 * i] = static_cast<float>(foot[1]) > static_cast<float>(parameters_.foot_radius) ? 1.0 : 0.0;
    }
    state[18] = first;
    state[19] = state[20] = pose.x;
    if (!valid(state.data())) throw std::invalid_argument("the pose is not finite or too large");
    assign(state.data());
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
    for (int i = 0; i < kLegs; ++i) {
        double* motion = state + 22 + 4 * i;
        motion[0] = motion_[i].torque;
        motion[1] = motion_[i].shortening;
        motion[2] = motion_[i].touchdown_angle;
        motion[3] = motion_[i].airborne ? 1.0 : 0.0;
    }
}

void Walker::restore(const double* state) {
    if (!valid(state)) throw std::invalid_argument("the numbers are not a saved state");
    assign(state);
}

void Walker::assign(const double* state) {
    set_body(trunk_, state);
    set_body(feet_[0], state + 6);
    set_body(feet_[1], state + 12);
    slot_ = {static_cast<int>(state[18]), 1 - static_cast<int>(state[18])};
    origin_ = state[19];
    last_touchdown_x_ = state[20];
    last_touchdown_side_ = static_cast<int>(state[21]);
    for (int i = 0; i < kLegs; ++i) {
        const double* motion = state + 22 + 4 * i;
        motion_[i] = Motion{motion[0], motion[1], motion[2], motion[3] != 0.0};
    }
}

}  // namespace romgrl
