// The task around a world, the same for every engine: random starts, reward, fall.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "rom/world_state.hpp"

namespace romgrl {

constexpr int kMostActions = 4;  // hip torques left and right; with leg motors their drives left and right
constexpr int kEpisodeState = 11;
constexpr int kState = kWalkerState + kEpisodeState;

// States of a gait that a share of the episodes begins in, each with the command that it belongs to.
struct ResetBank {
    std::vector<double> states;  // rows of kState numbers
    double share = 0.0;

    // Throws std::invalid_argument unless there are rows, each is a saved state, and the share is one.
    void fill(const double* rows, std::size_t count, double of_episodes);
};

struct Episode {
    std::uint64_t world = 0, seed = 0, number = 0;  // number: of the next episode
    std::int64_t steps = 0;
    double speed = 0.0;  // to be held, m/s
    double apex = 0.0;  // to be jumped, m
    std::array<double, kMostActions> previous_action{};

    void restart(std::uint64_t value);  // a new stream of random numbers
    void begin(const Parameters& parameters);  // an episode from a pose of the caller
    void begin(const Parameters& parameters, double* state);  // the next random episode, which starts in `state`
    void begin(const Parameters& parameters, const ResetBank& bank, double* state);  // the same, or one of the bank
    bool take_command(const Parameters& parameters, double& stiffness_share);  // if another one is due
    void save(double* numbers) const;
    void restore(const double* numbers);
};

bool is_state(const double* state);  // kState numbers: of the walker, then of the episode
double reward(const Parameters& parameters, double speed, double velocity, double positive_power);  // of all actuators, W
inline int action_size(const Parameters& parameters) { return parameters.leg_motor ? kMostActions : kLegs; }
bool fallen(const Parameters& parameters, double y, double pitch);

}  // namespace romgrl
