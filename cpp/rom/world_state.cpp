#include "rom/world_state.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>

#include "rom/arc_foot.hpp"

namespace romgrl {
namespace {

constexpr double kLargestNumber = 1e3;  // m, m/s, rad, rad/s
constexpr double kFarthest = 16.0;  // m from the origin, within Box2D's ground
constexpr double kLargestDrive = 2.0;  // a policy's is within 1; a return map disturbs it
constexpr double kLongestWay = 1e9;  // m, s; in float64 a step is still told from the next one

bool is_body(const double* state) {
    const auto small = [](double value) { return std::fabs(value) < kLargestNumber; };
    return std::all_of(state, state + 6, small) && std::fabs(state[0]) < kFarthest;
}

}  // namespace

bool is_walker_state(const double* state) {
    const auto finite = [](double value) { return std::isfinite(value); };
    const auto is_leg = [](const double* leg) {
        return std::fabs(leg[1]) < kLargestNumber && std::fabs(leg[2]) < kLargestNumber &&
               std::fabs(leg[4]) < kLargestNumber && std::fabs(leg[5]) < kLargestNumber && std::fabs(leg[6]) < kLargestDrive;
    };
    return is_body(state) && is_body(state + 6) && is_body(state + 12) &&
           std::all_of(state + 18, state + kWalkerState, finite) && (state[18] == 0.0 || state[18] == 1.0) &&
           std::fabs(state[19]) < kLongestWay && std::fabs(state[20]) < kLongestWay && std::fabs(state[21]) <= 1.0 &&
           state[22] > 0.0 && state[22] < kLargestNumber && state[23] >= 0.0 && state[23] < kLongestWay &&
           is_leg(state + kMotion) && is_leg(state + kMotion + kLegMotion);
}

// The two legs are solved one after the other. Which leg comes first follows from the pose and not from its name, so
// that a mirrored world is solved in the mirrored order and stays the mirror image bit for bit.
void pose_state(const Parameters& parameters, const Pose& pose, double* state) {
    std::fill_n(state, kWalkerState, 0.0);
    const double trunk[6] = {0.0, pose.y, -pose.pitch, pose.vx, pose.vy, -pose.pitch_rate};
    std::copy(trunk, trunk + 6, state);
    const auto key = [&pose](int i) {
        return std::make_tuple(pose.hip_angle[i], pose.hip_rate[i], pose.leg_length[i], pose.leg_rate[i]);
    };
    const int first = key(0) < key(1) ? 1 : 0;
    const ArcFoot arc(parameters);
    for (int i = 0; i < kLegs; ++i) {
        const double angle = pose.hip_angle[i] - pose.pitch, length = pose.leg_length[i];
        const double across = length * (pose.hip_rate[i] - pose.pitch_rate);
        const double s = std::sin(angle), c = std::cos(angle);
        double* foot = state + (i == first ? 6 : 12);
        foot[0] = length * s;
        foot[1] = pose.y - length * c;
        foot[3] = pose.vx + pose.leg_rate[i] * s + across * c;
        foot[4] = pose.vy - pose.leg_rate[i] * c + across * s;
        if (!(length > 0.0)) throw std::invalid_argument("the pose has a leg of no length");
        double* motion = state + kMotion + kLegMotion * i;
        motion[2] = std::fabs(angle);
        motion[3] = static_cast<float>(foot[1]) > static_cast<float>(arc.touch(-c)) ? 1.0 : 0.0;
        motion[4] = pose.extension[i];
        motion[5] = pose.extension_rate[i];
    }
    state[18] = first;
    state[22] = 1.0;
    state[19] = state[20] = pose.x;
    if (!is_walker_state(state)) throw std::invalid_argument("the pose is not finite or too large");
}

}  // namespace romgrl
