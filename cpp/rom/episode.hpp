// The task around a world, the same for every engine: random starts, reward, fall.
#pragma once

#include <array>
#include <cstdint>

#include "rom/world_state.hpp"

namespace romgrl {

constexpr int kActions = 2;
constexpr int kEpisodeState = 7;
constexpr int kState = kWalkerState + kEpisodeState;

struct Episode {
    std::uint64_t world = 0, seed = 0, number = 0;  // number: of the next episode
    std::int64_t steps = 0;
    std::array<double, kActions> previous_action{};

    void restart(std::uint64_t value);  // a new stream of random numbers
    void begin();  // an episode from a pose of the caller
    void begin(const Parameters& parameters, double* state);  // the next random episode, which starts in `state`
    void save(double* numbers) const;
    void restore(const double* numbers);
};

bool is_state(const double* state);  // kState numbers: of the walker, then of the episode
double reward(const Parameters& parameters, double velocity);
bool fallen(const Parameters& parameters, double y, double pitch);

}  // namespace romgrl
