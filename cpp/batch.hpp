// Many worlds stepped together. Worlds share nothing, so the split over threads cannot change a result.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "environment.hpp"
#include "pool.hpp"

namespace romgrl {

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
    bool* diverged;
};

class Batch {
  public:
    Batch(const Parameters& parameters, int worlds, int threads);
    ~Batch();

    int worlds() const { return static_cast<int>(environments_.size()); }
    int observation_size() const { return environments_.front()->observation_size(); }

    void seed(std::uint64_t value);
    void reset();  // all worlds
    void step(const float* actions, const StepArrays& arrays);
    void observe(float* observation, float* features, bool* contact) const;
    void place(int world, const Pose& pose);
    void save(double* states) const;
    void restore(const double* states);  // all or nothing

  private:
    void step_world(int world, const float* actions, const StepArrays& arrays);

    std::vector<std::unique_ptr<Environment>> environments_;
    std::unique_ptr<Pool> pool_;
    int owner_ = 0;  // process
};

}  // namespace romgrl
