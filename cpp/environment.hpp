// One world as a task: random resets, observation, reward, termination.
#pragma once

#include <array>
#include <cstdint>

#include "physics.hpp"

namespace romgrl {

constexpr int kActions = 2;
constexpr int kFullObservation = 20;
constexpr int kPaperObservation = 13;
constexpr int kFeatures = 5;

struct Outcome {
    float reward = 0.0F;
    float forward_velocity = 0.0F;  // mean of the trunk over the control step, m/s
    bool terminated = false;
    bool truncated = false;
    bool diverged = false;
};

class Environment {
  public:
    static constexpr int kStateSize = Walker::kStateSize + 7;

    Environment(const Parameters& parameters, std::uint64_t index);

    void seed(std::uint64_t value);  // starts again with episode 0
    void reset();  // places the next random episode
    void place(const Pose& pose);
    Outcome step(const float* action);

    int observation_size() const;
    void observe(float* observation) const;
    void features(float* output) const;
    void contact(bool* output) const;
    const Walker& walker() const { return walker_; }

    void save(double* state) const;
    void restore(const double* state);

  private:
    double draw(int index, double low, double high) const;
    bool fallen() const;
    void observe_full(float* observation) const;

    Parameters parameters_;
    Walker walker_;
    std::uint64_t index_, seed_ = 0, episode_ = 0;
    std::int64_t steps_ = 0;
    std::array<double, kActions> previous_action_{};
};

}  // namespace romgrl
