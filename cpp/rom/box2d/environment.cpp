#include "rom/box2d/environment.hpp"

#include <algorithm>
#include <cmath>

namespace romgrl {

Environment::Environment(const Parameters& parameters, std::uint64_t index, const ResetBank& bank)
    : parameters_(parameters), bank_(bank), walker_(parameters) {
    episode_.world = index;
    reset();
}

void Environment::reset() {
    std::array<double, kWalkerState> state{};
    episode_.begin(parameters_, bank_, state.data());
    walker_.place(state.data());
}

void Environment::place(const Pose& pose) {
    std::array<double, kWalkerState> state{};
    pose_state(parameters_, pose, state.data());
    episode_.begin(parameters_);
    walker_.place(state.data());
}

Outcome Environment::step(const float* action) {
    std::array<double, kLegs> torque{}, drive{};
    for (int i = 0; i < action_size(parameters_); ++i) {
        episode_.previous_action[i] = std::clamp<double>(action[i], -1.0, 1.0);
    }
    for (int i = 0; i < kLegs; ++i) {
        torque[i] = parameters_.hip_torque * episode_.previous_action[i];
        drive[i] = episode_.previous_action[kLegs + i];
    }
    const double start = walker_.x();
    std::array<double, kWalkerState> before{};
    walker_.save(before.data());
    Outcome outcome;
    outcome.diverged = !walker_.step(torque, drive);
    ++episode_.steps;
    if (outcome.diverged) {
        walker_.restore(before.data());  // the last finite state is what the caller sees
        outcome.terminated = true;
        return outcome;
    }
    const double velocity = (walker_.x() - start) * parameters_.control_frequency;
    outcome.forward_velocity = static_cast<float>(velocity);
    const double power = walker_.work().positive() * parameters_.control_frequency;
    outcome.reward = static_cast<float>(reward(parameters_, episode_.speed, velocity, power));
    outcome.terminated = fallen(parameters_, walker_.y(), walker_.pitch());
    outcome.truncated = !outcome.terminated && episode_.steps >= parameters_.episode_steps;
    return outcome;
}

// Lengths in leg lengths, speeds in sqrt(g L0), rates in sqrt(g / L0), forces in body weights.
void Environment::observe_full(float* o) const {
    const double length = parameters_.leg_length;
    const double gravity = parameters_.gravity > 0.0 ? parameters_.gravity : 1.0;
    const double speed = std::sqrt(gravity * length), rate = std::sqrt(gravity / length);
    const auto put = [o](int column, double value) { o[column] = static_cast<float>(value); };
    put(0, (walker_.x() - walker_.last_touchdown_x()) / length);
    put(1, walker_.y() / length);
    put(2, walker_.vx() / speed);
    put(3, walker_.vy() / speed);
    put(4, walker_.pitch());
    put(5, walker_.pitch_rate() / rate);
    for (int i = 0; i < kLegs; ++i) {
        const LegView leg = walker_.leg(i);
        put(6 + i, leg.length / length - 1.0);
        put(8 + i, leg.rate / speed);
        put(10 + i, leg.angle + walker_.pitch());
        put(12 + i, (leg.angle_rate + walker_.pitch_rate()) / rate);
        const double load = walker_.loaded(i, leg) ? walker_.axial_force(i, leg) : 0.0;
        put(14 + i, load / (parameters_.mass * gravity));
        put(16 + i, episode_.previous_action[i]);
    }
    put(18, episode_.speed / speed);
    put(19, walker_.last_touchdown_side());
    for (int i = 0; i < kLegs && parameters_.leg_motor; ++i) {
        put(20 + i, walker_.extension(i) / length);
        put(22 + i, walker_.extension_rate(i) / speed);
        put(24 + i, episode_.previous_action[kLegs + i]);
    }
    put(26, walker_.stiffness_share());
    put(27, walker_.touchdown_age() * rate);
    put(28, std::sqrt(2.0 * episode_.apex / length));
}

void Environment::observe(float* observation) const {
    std::array<float, kMotorObservation> full{};
    observe_full(full.data());
    write_observation(parameters_, full.data(), observation);
}

void Environment::features(float* output) const {
    output[0] = static_cast<float>(walker_.y());
    for (int i = 0; i < kLegs; ++i) {
        const LegView leg = walker_.leg(i);
        output[1 + 2 * i] = static_cast<float>(leg.length * leg.along_x);
        output[2 + 2 * i] = static_cast<float>(leg.length * leg.along_y);
    }
}

void Environment::contact(bool* output) const {
    for (int i = 0; i < kLegs; ++i) output[i] = walker_.leg(i).contact;
}

bool Environment::take_command() {
    double share = walker_.stiffness_share();
    if (!episode_.take_command(parameters_, share)) return false;
    walker_.set_stiffness_share(share);
    return true;
}

void Environment::save(double* state) const {
    walker_.save(state);
    episode_.save(state + kWalkerState);
}

void Environment::restore(const double* state) {
    walker_.restore(state);
    episode_.restore(state + kWalkerState);
}

}  // namespace romgrl
