// Many worlds stepped together. Worlds share nothing, so the split over threads cannot change a result.
#pragma once

#include <cstdint>
#include <memory>

#include "common/thread_pool.hpp"
#include "rom/engine.hpp"

namespace romgrl {

class Batch {
  public:
    Batch(const Parameters& parameters, int worlds, int threads);
    ~Batch();

    int worlds() const { return count_; }
    int observation_size() const { return observation_size_; }
    int action_size() const { return action_size_; }

    void seed(std::uint64_t value) { worlds_->seed(value); }
    void reset() { worlds_->reset(); }  // all worlds
    void step(const float* actions, const StepArrays& arrays);
    void observe(float* observation, float* features, bool* contact) const;
    void place(int world, const Pose& pose);
    void save(double* states) const;
    void restore(const double* states);  // all or nothing
    // From now on a share of the episodes begins in one of the states.
    void begin_in(const double* states, int count, double share) { bank_.fill(states, count, share); }

  private:
    int count_, observation_size_, action_size_;
    ResetBank bank_;
    std::unique_ptr<Worlds> worlds_;  // which read the bank
    std::unique_ptr<Pool> pool_;
    int owner_ = 0;  // process
};

}  // namespace romgrl
