#include "rom/episode.hpp"

#include <algorithm>
#include <cmath>

#include "common/counter_random.hpp"

namespace romgrl {
namespace {

constexpr double kTouch = 1e-4;  // m; feet start this deep in the ground, so that rounding cannot lift them
constexpr double kLargestInteger = 9007199254740992.0;  // 2^53

}  // namespace

void Episode::restart(std::uint64_t value) {
    seed = value;
    number = 0;
}

void Episode::begin() {
    steps = 0;
    previous_action.fill(0.0);
}

// Anti-phase start at the touchdown of the front foot, which rests; the rear foot moves with the trunk.
void Episode::begin(const Parameters& p, double* state) {
    const auto draw = [this](std::uint64_t index, double low, double high) {
        return low + (high - low) * uniform(seed, world, number, index);
    };
    const double angle = draw(0, p.reset_hip_angle_low, p.reset_hip_angle_high);
    const double speed = p.speed * draw(1, p.reset_speed_low, p.reset_speed_high);
    const int front = draw(2, 0.0, 1.0) < 0.5 ? 0 : 1;
    Pose pose;
    pose.y = p.leg_length * std::cos(angle) + p.foot_radius - kTouch;
    pose.vx = speed;
    pose.leg_length.fill(p.leg_length);
    pose.hip_angle[front] = angle;
    pose.hip_angle[1 - front] = -angle;
    pose.leg_rate[front] = -speed * std::sin(angle);
    pose.hip_rate[front] = -speed * std::cos(angle) / p.leg_length;
    pose_state(p, pose, state);
    state[21] = front == 0 ? 1.0 : -1.0;
    begin();
    ++number;
}

void Episode::save(double* numbers) const {
    numbers[0] = previous_action[0];
    numbers[1] = previous_action[1];
    numbers[2] = static_cast<double>(steps);
    numbers[3] = static_cast<double>(number);
    numbers[4] = static_cast<double>(seed >> 32);
    numbers[5] = static_cast<double>(seed & 0xFFFFFFFFULL);
    numbers[6] = static_cast<double>(world);
}

void Episode::restore(const double* numbers) {
    previous_action = {numbers[0], numbers[1]};
    steps = static_cast<std::int64_t>(numbers[2]);
    number = static_cast<std::uint64_t>(numbers[3]);
    seed = (static_cast<std::uint64_t>(numbers[4]) << 32) | static_cast<std::uint64_t>(numbers[5]);
    world = static_cast<std::uint64_t>(numbers[6]);
}

bool is_state(const double* state) {
    const double* own = state + kWalkerState;
    const auto action = [](double value) { return std::fabs(value) <= 1.0; };
    const auto whole = [](double value) { return value >= 0.0 && value < kLargestInteger && value == std::floor(value); };
    return is_walker_state(state) && std::all_of(own, own + 2, action) && std::all_of(own + 2, own + 7, whole) &&
           std::max(own[4], own[5]) < 4294967296.0;
}

double reward(const Parameters& p, double velocity) {
    return p.reward_is_velocity ? velocity : std::exp(-p.alpha * std::fabs(velocity - p.speed));
}

bool fallen(const Parameters& p, double y, double pitch) {
    return y < p.fall_height * p.leg_length || (!p.trunk_locked && std::fabs(pitch) > p.trunk_pitch_limit);
}

}  // namespace romgrl
