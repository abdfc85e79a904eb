#include "rom/episode.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "common/counter_random.hpp"
#include "rom/arc_foot.hpp"

namespace romgrl {
namespace {

constexpr double kTouch = 1e-4;  // m; feet start this deep in the ground, so that rounding cannot lift them
constexpr std::uint64_t kCommandDraws = 4;  // index of the first draw of a command; those before it are of the start
constexpr std::uint64_t kApexDraws = std::uint64_t{1} << 32;
constexpr std::uint64_t kBankDraws = 1ULL << 62;  // beyond those of any command
constexpr double kLargestInteger = 9007199254740992.0;  // 2^53

// A leg whose foot rests on the ground, or rolls on it, while the trunk moves: the velocity of its lowest point is 0.
void stand(const Parameters& p, int leg, double angle, Pose& pose) {
    const ArcFoot arc(p);
    const double s = std::sin(angle), c = std::cos(angle), rolled = arc.rolls ? arc.radius : 0.0;
    pose.hip_angle[leg] = angle;
    pose.hip_rate[leg] = -(pose.vx * c + pose.vy * s) / (p.leg_length + rolled * c - arc.offset);
    pose.leg_rate[leg] = pose.vy * c - pose.vx * s - rolled * s * pose.hip_rate[leg];
}

}  // namespace

void Episode::restart(std::uint64_t value) {
    seed = value;
    number = 0;
}

void Episode::begin(const Parameters& p) {
    steps = 0;
    speed = 0.5 * (p.speed_low + p.speed_high);
    apex = 0.5 * (p.apex_low + p.apex_high);
    previous_action.fill(0.0);
}

// Numbers of a command are drawn with the number of the episode that goes on, which is one less than the next.
bool Episode::take_command(const Parameters& p, double& stiffness_share) {
    if (p.command_steps == 0 || steps == 0 || steps % p.command_steps != 0) return false;
    const std::uint64_t index = kCommandDraws + 2 * static_cast<std::uint64_t>(steps / p.command_steps);
    const auto draw = [&](std::uint64_t at, double low, double high) {
        return low + (high - low) * uniform(seed, world, number - 1, at);
    };
    speed = draw(index, p.speed_low, p.speed_high);
    stiffness_share = draw(index + 1, p.stiffness_share_low, p.stiffness_share_high);
    apex = draw(kApexDraws + index, p.apex_low, p.apex_high);
    return true;
}

// Start at a touchdown: of the front foot, while the rear one, as far behind, moves with the trunk; or of both together.
void Episode::begin(const Parameters& p, double* state) {
    const auto draw = [this](std::uint64_t index, double low, double high) {
        return low + (high - low) * uniform(seed, world, number, index);
    };
    begin(p);
    speed = draw(kCommandDraws, p.speed_low, p.speed_high);
    apex = draw(kApexDraws, p.apex_low, p.apex_high);
    const double usual = std::sqrt(std::fmax(p.gravity, 1.0) * p.leg_length);
    const double drawn = draw(0, p.reset_hip_angle_low, p.reset_hip_angle_high);
    const double angle = p.reset_by_speed ? std::fmin(drawn * speed / usual, p.hip_angle_limit) : drawn;
    const int front = draw(2, 0.0, 1.0) < 0.5 ? 0 : 1;
    Pose pose;
    const ArcFoot arc(p);
    pose.y = (p.leg_length - arc.offset) * std::cos(angle) + arc.radius - kTouch;
    pose.vx = speed * draw(1, p.reset_speed_low, p.reset_speed_high);
    pose.vy = -std::sqrt(2.0 * p.gravity * draw(3, p.reset_drop_low, p.reset_drop_high));
    pose.leg_length.fill(p.leg_length);
    stand(p, front, angle, pose);
    if (p.reset_together) {
        stand(p, 1 - front, angle, pose);
    } else {
        pose.hip_angle[1 - front] = -angle;
    }
    pose_state(p, pose, state);
    state[21] = front == 0 ? 1.0 : -1.0;
    state[22] = draw(kCommandDraws + 1, p.stiffness_share_low, p.stiffness_share_high);
    ++number;
}

// A state goes on as if its world had not stopped, but with the clock, the number and the random stream of this episode.
void Episode::begin(const Parameters& p, const ResetBank& bank, double* state) {
    if (bank.share == 0.0 || uniform(seed, world, number, kBankDraws) >= bank.share) {
        begin(p, state);
        return;
    }
    const std::size_t rows = bank.states.size() / kState;
    const double drawn = uniform(seed, world, number, kBankDraws + 1) * static_cast<double>(rows);
    const double* row = bank.states.data() + kState * std::min(static_cast<std::size_t>(drawn), rows - 1);
    std::copy_n(row, kWalkerState, state);
    std::copy_n(row + kWalkerState, kMostActions, previous_action.begin());
    speed = row[kWalkerState + kMostActions];
    apex = row[kState - 1];
    steps = 0;
    ++number;
}

void ResetBank::fill(const double* rows, std::size_t count, double of_episodes) {
    if (count == 0) throw std::invalid_argument("a bank needs a state at least");
    if (!(of_episodes >= 0.0 && of_episodes <= 1.0)) throw std::invalid_argument("the share of a bank must be 0 to 1");
    for (std::size_t row = 0; row < count; ++row) {
        if (!is_state(rows + kState * row)) throw std::invalid_argument("the numbers are not a saved state");
    }
    states.assign(rows, rows + kState * count);
    for (std::size_t row = 0; row < count; ++row) {
        double* state = states.data() + kState * row;
        state[20] -= state[19];  // an episode begins at the origin
        state[19] = 0.0;
    }
    share = of_episodes;
}

void Episode::save(double* numbers) const {
    std::copy(previous_action.begin(), previous_action.end(), numbers);
    numbers[4] = speed;
    numbers[5] = static_cast<double>(steps);
    numbers[6] = static_cast<double>(number);
    numbers[7] = static_cast<double>(seed >> 32);
    numbers[8] = static_cast<double>(seed & 0xFFFFFFFFULL);
    numbers[9] = static_cast<double>(world);
    numbers[10] = apex;
}

void Episode::restore(const double* numbers) {
    std::copy_n(numbers, kMostActions, previous_action.begin());
    speed = numbers[4];
    steps = static_cast<std::int64_t>(numbers[5]);
    number = static_cast<std::uint64_t>(numbers[6]);
    seed = (static_cast<std::uint64_t>(numbers[7]) << 32) | static_cast<std::uint64_t>(numbers[8]);
    world = static_cast<std::uint64_t>(numbers[9]);
    apex = numbers[10];
}

bool is_state(const double* state) {
    const double* own = state + kWalkerState;
    const auto action = [](double value) { return std::fabs(value) <= 1.0; };
    const auto whole = [](double value) { return value >= 0.0 && value < kLargestInteger && value == std::floor(value); };
    return is_walker_state(state) && std::all_of(own, own + kMostActions, action) && own[4] >= 0.0 && own[4] < 1e3 &&
           std::all_of(own + 5, own + 10, whole) && std::max(own[7], own[8]) < 4294967296.0 && own[10] >= 0.0 &&
           own[10] < 1e3;
}

// The cost of the actuators' work is per body weight and sqrt(g L0).
double reward(const Parameters& p, double speed, double velocity, double positive_power) {
    const double held = p.reward_is_velocity ? velocity : std::exp(-p.alpha * std::fabs(velocity - speed));
    if (p.work_cost == 0.0) return held;
    const double gravity = p.gravity > 0.0 ? p.gravity : 1.0;
    return held - p.work_cost * positive_power / (p.mass * gravity * std::sqrt(gravity * p.leg_length));
}

bool fallen(const Parameters& p, double y, double pitch) {
    return y < p.fall_height * p.leg_length || (!p.trunk_locked && std::fabs(pitch) > p.trunk_pitch_limit);
}

}  // namespace romgrl
