// Counter-based random numbers: a number is a function of (seed, world, episode, draw) alone, so the order in which worlds
// are stepped, and by which thread, cannot matter.
#pragma once

#include <cstdint>

namespace romgrl {

// Finaliser of SplitMix64 (Steele, Lea and Flood 2014).
inline std::uint64_t mix(std::uint64_t z) {
    z += 0x9E3779B97F4A7C15ULL;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31);
}

// Uniform in [0, 1).
inline double uniform(std::uint64_t seed, std::uint64_t world, std::uint64_t episode, std::uint64_t draw) {
    const std::uint64_t bits = mix(mix(mix(mix(seed) ^ world) ^ episode) ^ draw);
    return static_cast<double>(bits >> 11) * 0x1.0p-53;
}

}  // namespace romgrl
