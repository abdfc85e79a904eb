#include "environment.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "random.hpp"

namespace romgrl {
namespace {

constexpr double kTouch = 1e-4;  // m; feet start this deep in the ground, so that rounding cannot lift them
constexpr double kLargestInteger = 9007199254740992.0;  // 2^53

// Columns of the full observation that the paper lists: position, velocity, spring lengths and rates, hip angles and
// rates, target speed.
constexpr std::array<int, kPaperObservation> kPaperColumns{0, 1, 2, 3, 6, 7, 8, 9, 10, 11, 12, 13, 18};

}  // namespace

Environment::Environment(const Parameters& parameters, std::uint64_t index)
    : parameters_(parameters), walker_(parameters), index_(index) {
    reset();
}

void Environment::seed(std::uint64_t value) {
    seed_ = value;
    episode_ = 0;
}

double Environment::draw(int index, double low, double high) const {
    return low + (high - low) * uniform(seed_, index_, episode_, static_cast<std::uint64_t>(index));
}

// Anti-phase start at the touchdown of the front foot, which rests; the rear foot moves with the trunk.
void Environment::reset() {
    const double angle = draw(0, parameters_.reset_hip_angle_low, parameters_.reset_hip_angle_high);
    const double speed = parameters_.speed * draw(1, parameters_.reset_speed_low, parameters_.reset_speed_high);
    const int front = draw(2, 0.0, 1.0) < 0.5 ? 0 : 1;
    Pose pose;
    pose.y = parameters_.leg_length * std::cos(angle) + parameters_.foot_radius - kTouch;
    pose.vx = speed;
    pose.leg_length.fill(parameters_.leg_length);
    pose.hip_angle[front] = angle;
    pose.hip_angle[1 - front] = -angle;
    pose.leg_rate[front] = -speed * std::sin(angle);
    pose.hip_rate[front] = -speed * std::cos(angle) / parameters_.leg_length;
    place(pose);
    walker_.set_last_touchdown(front == 0 ? 1 : -1, 0.0);
    ++episode_;
}

void Environment::place(const Pose& pose) {
    walker_.place(pose);
    steps_ = 0;
    previous_action_.fill(0.0);
}

bool Environment::fallen() const {
    const bool low = walker_.y() < parameters_.fall_height * parameters_.leg_length;
    return low || (!parameters_.trunk_locked && std::fabs(walker_.pitch()) > parameters_.trunk_pitch_limit);
}

Outcome Environment::step(const float* action) {
    std::array<double, kLegs> command{};
    for (int i = 0; i < kActions; ++i) {
        previous_action_[i] = std::clamp<double>(action[i], -1.0, 1.0);
        command[i] = parameters_.hip_torque * previous_action_[i];
    }
    const double start = walker_.x();
    std::array<double, Walker::kStateSize> before{};
    walker_.save(before.data());
    Outcome outcome;
    outcome.diverged = !walker_.step(command);
    ++steps_;
    if (outcome.diverged) {
        walker_.assign(before.data());  // the last finite state is what the caller sees
        outcome.terminated = true;
        return outcome;
    }
    const double velocity = (walker_.x() - start) * parameters_.control_frequency;
    const double reward = parameters_.reward_is_velocity
                              ? velocity
                              : std::exp(-parameters_.alpha * std::fabs(velocity - parameters_.speed));
    outcome.forward_velocity = static_cast<float>(velocity);
    outcome.reward = static_cast<float>(reward);
    outcome.terminated = fallen();
    outcome.truncated = !outcome.terminated && steps_ >= parameters_.episode_steps;
    return outcome;
}

int Environment::observation_size() const {
    return parameters_.observation_is_paper ? kPaperObservation : kFullObservation;
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
        put(16 + i, previous_action_[i]);
    }
    put(18, parameters_.speed / speed);
    put(19, walker_.last_touchdown_side());
}

void Environment::observe(float* observation) const {
    std::array<float, kFullObservation> full{};
    observe_full(full.data());
    if (!parameters_.observation_is_paper) {
        std::copy(full.begin(), full.end(), observation);
        return;
    }
    for (int i = 0; i < kPaperObservation; ++i) observation[i] = full[kPaperColumns[i]];
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

void Environment::save(double* state) const {
    walker_.save(state);
    double* own = state + Walker::kStateSize;
    own[0] = previous_action_[0];
    own[1] = previous_action_[1];
    own[2] = static_cast<double>(steps_);
    own[3] = static_cast<double>(episode_);
    own[4] = static_cast<double>(seed_ >> 32);
    own[5] = static_cast<double>(seed_ & 0xFFFFFFFFULL);
    own[6] = static_cast<double>(index_);
}

void Environment::restore(const double* state) {
    const double* own = state + Walker::kStateSize;
    const auto action = [](double value) { return std::fabs(value) <= 1.0; };
    const auto whole = [](double value) { return value >= 0.0 && value < kLargestInteger && value == std::floor(value); };
    const bool valid = std::all_of(own, own + 2, action) && std::all_of(own + 2, own + 7, whole) &&
                       std::max(own[4], own[5]) < 4294967296.0;
    if (!valid) throw std::invalid_argument("the numbers are not a saved state");
    walker_.restore(state);
    previous_action_ = {own[0], own[1]};
    steps_ = static_cast<std::int64_t>(own[2]);
    episode_ = static_cast<std::uint64_t>(own[3]);
    seed_ = (static_cast<std::uint64_t>(own[4]) << 32) | static_cast<std::uint64_t>(own[5]);
    index_ = static_cast<std::uint64_t>(own[6]);
}

}  // namespace romgrl
