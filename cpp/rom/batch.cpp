#include "rom/batch.hpp"

#include <unistd.h>

#include <algorithm>
#include <stdexcept>

namespace romgrl {

Batch::Batch(const Parameters& parameters, int worlds, int threads)
    : count_(worlds),
      observation_size_(romgrl::observation_size(parameters)),
      action_size_(romgrl::action_size(parameters)) {
    validate(parameters);
    if (worlds < 1 || worlds > 100000) throw std::invalid_argument("the number of worlds must be 1 to 100000");
    if (threads < 1 || threads > 1024) throw std::invalid_argument("the number of threads must be 1 to 1024");
    worlds_ = parameters.engine_is_native ? native_worlds(parameters, worlds, bank_) : box2d_worlds(parameters, worlds, bank_);
    const int blocks = (worlds + worlds_->block() - 1) / worlds_->block();
    pool_ = std::make_unique<Pool>(std::min(threads, blocks));
    owner_ = getpid();
}

// A forked child has no threads to join, and waiting for them would hang it: it lets go of them.
Batch::~Batch() {
    if (getpid() != owner_) static_cast<void>(pool_.release());
}

void Batch::step(const float* actions, const StepArrays& arrays) {
    const Pool::Work work = [&](int begin, int end) {
        for (int block = begin; block < end; ++block) worlds_->step(block, actions, arrays);
    };
    const int blocks = (count_ + worlds_->block() - 1) / worlds_->block();
    if (getpid() == owner_) {
        pool_->run(blocks, work);
    } else {
        work(0, blocks);
    }
}

void Batch::observe(float* observation, float* features, bool* contact) const {
    worlds_->observe(observation, features, contact);
}

void Batch::place(int world, const Pose& pose) {
    if (world < 0 || world >= count_) throw std::invalid_argument("there is no world of this index");
    worlds_->place(world, pose);
}

void Batch::save(double* states) const {
    for (int world = 0; world < count_; ++world) worlds_->save(world, states + kState * world);
}

void Batch::restore(const double* states) {
    for (int world = 0; world < count_; ++world) {
        if (!is_state(states + kState * world)) throw std::invalid_argument("the numbers are not a saved state");
    }
    for (int world = 0; world < count_; ++world) worlds_->restore(world, states + kState * world);
}

}  // namespace romgrl
