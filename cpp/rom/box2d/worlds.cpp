// Worlds in Box2D, stepped one at a time.
#include <algorithm>
#include <mutex>
#include <vector>

#include "rom/box2d/environment.hpp"

namespace romgrl {
namespace {

// Box2D fills global tables at the first contact; do it before there are threads.
void warm_up() {
    static std::once_flag once;
    std::call_once(once, [] {
        const Parameters parameters;
        const ResetBank bank;
        Environment environment(parameters, 0, bank);
        Pose pose;
        pose.y = 0.9;
        pose.leg_length.fill(parameters.leg_length);
        environment.place(pose);
        const float action[kMostActions] = {};
        environment.step(action);
    });
}

class Box2DWorlds : public Worlds {
  public:
    Box2DWorlds(const Parameters& parameters, int worlds, const ResetBank& bank)
        : size_(observation_size(parameters)), actions_(action_size(parameters)) {
        warm_up();
        environments_.reserve(worlds);
        for (int i = 0; i < worlds; ++i) {
            environments_.push_back(std::make_unique<Environment>(parameters, static_cast<std::uint64_t>(i), bank));
        }
    }

    int block() const override { return 1; }

    void seed(std::uint64_t value) override {
        for (auto& environment : environments_) environment->seed(value);
    }

    void reset() override {
        for (auto& environment : environments_) environment->reset();
    }

    void place(int world, const Pose& pose) override { environments_[world]->place(pose); }
    void save(int world, double* state) const override { environments_[world]->save(state); }
    void restore(int world, const double* state) override { environments_[world]->restore(state); }

    void observe(float* observation, float* features, bool* contact) const override {
        for (std::size_t world = 0; world < environments_.size(); ++world) {
            environments_[world]->observe(observation + size_ * world);
            environments_[world]->features(features + kFeatures * world);
            environments_[world]->contact(contact + kLegs * world);
        }
    }

    void step(int world, const float* actions, const StepArrays& arrays) override {
        Environment& environment = *environments_[world];
        const Outcome outcome = environment.step(actions + actions_ * world);
        float* final_observation = arrays.final_observation + size_ * world;
        float* features = arrays.features + kFeatures * world;
        environment.observe(final_observation);
        environment.features(features);
        environment.contact(arrays.contact + kLegs * world);
        arrays.reward[world] = outcome.reward;
        arrays.terminated[world] = outcome.terminated;
        arrays.truncated[world] = outcome.truncated;
        arrays.diverged[world] = outcome.diverged;
        arrays.forward_velocity[world] = outcome.forward_velocity;
        for (int i = 0; i < kLegs; ++i) {
            arrays.ground_force[kLegs * world + i] = static_cast<float>(environment.walker().ground_force()[i]);
            arrays.hip_torque[kLegs * world + i] = static_cast<float>(environment.walker().hip_torque()[i]);
        }
        write_power(environment.parameters(), outcome.diverged ? Work{} : environment.walker().work(), world, arrays);
        float* observation = arrays.observation + size_ * world;
        float* reset_features = arrays.reset_features + kFeatures * world;
        const bool ended = outcome.terminated || outcome.truncated;
        if (ended) environment.reset();
        if (ended || environment.take_command()) {
            environment.observe(observation);
            environment.features(reset_features);
        } else {
            std::copy_n(final_observation, size_, observation);
            std::copy_n(features, kFeatures, reset_features);
        }
    }

  private:
    int size_, actions_;
    std::vector<std::unique_ptr<Environment>> environments_;
};

}  // namespace

std::unique_ptr<Worlds> box2d_worlds(const Parameters& parameters, int worlds, const ResetBank& bank) {
    return std::make_unique<Box2DWorlds>(parameters, worlds, bank);
}

}  // namespace romgrl
