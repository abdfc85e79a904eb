// What an engine has to offer: worlds that can be placed, stepped, observed, saved and restored.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>

#include "rom/episode.hpp"
#include "rom/work.hpp"

namespace romgrl {

constexpr int kFullObservation = 20;
constexpr int kMotorObservation = 29;  // with leg motors
constexpr int kPaperObservation = 13;
constexpr int kFeatures = 5;

// Arrays of the caller, C-contiguous, one row per world. Rows of final_* and of the other arrays but observation and
// reset_features are from before the autoreset.
struct StepArrays {
    float* observation;
    float* reward;
    bool* terminated;
    bool* truncated;
    float* final_observation;
    float* features;
    float* reset_features;
    bool* contact;
    float* forward_velocity;
    float* ground_force;
    float* hip_torque;
    float* power;  // of all actuators, absolute values: W, mean over the step
    float* positive_power;
    float* retraction_power;
    float* positive_retraction_power;
    float* leg_motor_power;
    float* positive_leg_motor_power;
    bool* diverged;
};

inline void write_power(const Parameters& parameters, const Work& work, int world, const StepArrays& arrays) {
    const auto mean = [&parameters](double joules) { return static_cast<float>(joules * parameters.control_frequency); };
    arrays.power[world] = mean(work.hip + work.retraction + work.leg_motor);
    arrays.positive_power[world] = mean(work.positive());
    arrays.retraction_power[world] = mean(work.retraction);
    arrays.positive_retraction_power[world] = mean(work.positive_retraction);
    arrays.leg_motor_power[world] = mean(work.leg_motor);
    arrays.positive_leg_motor_power[world] = mean(work.positive_leg_motor);
}

inline int observation_size(const Parameters& parameters) {
    if (parameters.leg_motor) return kMotorObservation;
    return parameters.observation_is_paper ? kPaperObservation : kFullObservation;
}

// Columns in the order that the paper lists them, if it is the paper's observation: position, velocity, spring lengths
// and rates, hip angles and rates, target speed.
inline void write_observation(const Parameters& parameters, const float* full, float* observation) {
    constexpr std::array<int, kPaperObservation> paper{0, 1, 2, 3, 6, 7, 8, 9, 10, 11, 12, 13, 18};
    if (!parameters.observation_is_paper) {
        std::copy_n(full, observation_size(parameters), observation);
        return;
    }
    for (int i = 0; i < kPaperObservation; ++i) observation[i] = full[paper[i]];
}

class Worlds {
  public:
    virtual ~Worlds() = default;

    virtual int block() const = 0;  // so many worlds are stepped together
    virtual void step(int block, const float* actions, const StepArrays& arrays) = 0;
    virtual void observe(float* observation, float* features, bool* contact) const = 0;
    virtual void seed(std::uint64_t value) = 0;
    virtual void reset() = 0;
    virtual void place(int world, const Pose& pose) = 0;
    virtual void save(int world, double* state) const = 0;
    virtual void restore(int world, const double* state) = 0;  // is_state() holds
};

// The bank outlives the worlds; it changes between their steps alone.
std::unique_ptr<Worlds> box2d_worlds(const Parameters& parameters, int worlds, const ResetBank& bank);
std::unique_ptr<Worlds> native_worlds(const Parameters& parameters, int worlds, const ResetBank& bank);

}  // namespace romgrl
