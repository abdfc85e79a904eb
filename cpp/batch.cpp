#include "batch.hpp"

#include <unistd.h>

#include <algorithm>
#include <mutex>
#include <stdexcept>

namespace romgrl {
namespace {

// Box2D fills global tables at the first contact; do it before there are threads.
void warm_up() {
    static std::once_flag once;
    std::call_once(once, [] {
        Walker walker(Parameters{});
        Pose pose;
        pose.y = 0.9;
        pose.leg_length.fill(0.865);
        walker.place(pose);
        walker.step({0.0, 0.0});
    });
}

}  // namespace

Batch::Batch(const Parameters& parameters, int worlds, int threads) {
    validate(parameters);
    if (worlds < 1 || worlds > 100000) throw std::invalid_argument("the number of worlds must be 1 to 100000");
    if (threads < 1 || threads > 1024) throw std::invalid_argument("the number of threads must be 1 to 1024");
    warm_up();
    environments_.reserve(worlds);
    for (int i = 0; i < worlds; ++i) {
        environments_.push_back(std::make_unique<Environment>(parameters, static_cast<std::uint64_t>(i)));
    }
    pool_ = std::make_unique<Pool>(std::min(threads, worlds));
    owner_ = getpid();
}

// A forked child has no threads to join, and waiting for them would hang it: it lets go of them.
Batch::~Batch() {
    if (getpid() != owner_) static_cast<void>(pool_.release());
}

void Batch::seed(std::uint64_t value) {
    for (auto& environment : environments_) environment->seed(value);
}

void Batch::reset() {
    for (auto& environment : environments_) environment->reset();
}

void Batch::step_world(int world, const float* actions, const StepArrays& arrays) {
    Environment& environment = *environments_[world];
    const Outcome outcome = environment.step(actions + kActions * world);
    const int size = environment.observation_size();
    float* final_observation = arrays.final_observation + size * world;
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
    float* observation = arrays.observation + size * world;
    float* reset_features = arrays.reset_features + kFeatures * world;
    if (outcome.terminated || outcome.truncated) {
        environment.reset();
        environment.observe(observation);
        environment.features(reset_features);
    } else {
        std::copy_n(final_observation, size, observation);
        std::copy_n(features, kFeatures, reset_features);
    }
}

void Batch::step(const float* actions, const StepArrays& arrays) {
    const Pool::Work chunk = [&](int begin, int end) {
        for (int world = begin; world < end; ++world) step_world(world, actions, arrays);
    };
    if (getpid() == owner_) {
        pool_->run(worlds(), chunk);
    } else {
        chunk(0, worlds());
    }
}

void Batch::observe(float* observation, float* features, bool* contact) const {
    const int size = observation_size();
    for (int world = 0; world < worlds(); ++world) {
        environments_[world]->observe(observation + size * world);
        environments_[world]->features(features + kFeatures * world);
        environments_[world]->contact(contact + kLegs * world);
    }
}

void Batch::place(int world, const Pose& pose) {
    if (world < 0 || world >= worlds()) throw std::invalid_argument("there is no world of this index");
    environments_[world]->place(pose);
}

void Batch::save(double* states) const {
    for (int world = 0; world < worlds(); ++world) {
        environments_[world]->save(states + Environment::kStateSize * world);
    }
}

void Batch::restore(const double* states) {
    std::vector<double> before(static_cast<std::size_t>(Environment::kStateSize) * worlds());
    save(before.data());
    try {
        for (int world = 0; world < worlds(); ++world) {
            environments_[world]->restore(states + Environment::kStateSize * world);
        }
    } catch (const std::invalid_argument&) {
        for (int world = 0; world < worlds(); ++world) {
            environments_[world]->restore(before.data() + Environment::kStateSize * world);
        }
        throw;
    }
}

}  // namespace romgrl
