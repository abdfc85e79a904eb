// Worlds of the native engine: actions and states go into lanes, observations and outcomes come out of them.
#include <algorithm>
#include <cmath>
#include <vector>

#include "rom/native/native.hpp"
#include "rom/engine.hpp"

namespace romgrl {
namespace {

class NativeWorlds : public Worlds {
  public:
    NativeWorlds(const Parameters& parameters, int worlds, const ResetBank& bank)
        : parameters_(parameters),
          bank_(bank),
          constants_(parameters),
          count_(worlds),
          size_(observation_size(parameters)),
          actions_(action_size(parameters)),
          groups_((worlds + kLanes - 1) / kLanes),
          episodes_(worlds) {
        for (int world = 0; world < worlds; ++world) episodes_[world].world = static_cast<std::uint64_t>(world);
        Episode().begin(parameters, idle_.data());
        reset();
    }

    int block() const override { return kLanes; }

    void seed(std::uint64_t value) override {
        for (Episode& episode : episodes_) episode.restart(value);
    }

    void reset() override {
        for (int world = 0; world < count_; ++world) begin(world);
    }

    void place(int world, const Pose& pose) override {
        double state[kWalkerState];
        pose_state(parameters_, pose, state);
        episodes_[world].begin(parameters_);
        put(world, state);
    }

    void save(int world, double* state) const override {
        get_lane(groups_[world / kLanes], world % kLanes, state);
        episodes_[world].save(state + kWalkerState);
    }

    void restore(int world, const double* state) override {
        put(world, state);
        episodes_[world].restore(state + kWalkerState);
    }

    void observe(float* observation, float* features, bool* contact) const override {
        for (std::size_t block = 0; block < groups_.size(); ++block) {
            View view;
            native_view(constants_, groups_[block], view);
            for (int world = first(block); world < last(block); ++world) {
                write(world, view, observation, features);
                write_contact(world, view, contact);
            }
        }
    }

    void step(int block, const float* actions, const StepArrays& arrays) override {
        Group& group = groups_[block];
        // Lanes without a world start over at every step, lest they fall and keep the stops busy.
        for (int world = last(block); world < first(block) + kLanes; ++world) put(world, idle_.data());
        const Group before = group;
        WorkLanes work;
        native_step(constants_, take_actions(block, actions), group, work);
        bool diverged[kLanes];
        for (int n = 0; n < kLanes; ++n) {
            diverged[n] = !sane(group, n);
            if (diverged[n]) copy_lane(before, n, group);  // the last finite state is what the caller sees
        }
        View view;
        native_view(constants_, group, view);
        bool changed[kLanes], again = false;
        for (int world = first(block); world < last(block); ++world) {
            write(world, view, arrays.final_observation, arrays.features);
            write_contact(world, view, arrays.contact);
            const int n = world - first(block);
            const Work done{work.hip[n],   work.positive_hip[n],  work.retraction[n], work.positive_retraction[n],
                            work.leg_motor[n], work.positive_leg_motor[n]};
            write_power(parameters_, diverged[n] ? Work{} : done, world, arrays);
            changed[n] = finish(world, before, diverged[n], arrays);
            again |= changed[n];
        }
        if (again) native_view(constants_, group, view);
        for (int world = first(block); world < last(block); ++world) {
            if (changed[world - first(block)]) {
                write(world, view, arrays.observation, arrays.reset_features);
            } else {
                std::copy_n(arrays.final_observation + size_ * world, size_, arrays.observation + size_ * world);
                std::copy_n(arrays.features + kFeatures * world, kFeatures, arrays.reset_features + kFeatures * world);
            }
        }
    }

  private:
    int first(std::size_t block) const { return static_cast<int>(block) * kLanes; }
    int last(std::size_t block) const { return std::min(first(block) + kLanes, count_); }

    void begin(int world) {
        double state[kWalkerState];
        episodes_[world].begin(parameters_, bank_, state);
        put(world, state);
    }

    void put(int world, const double* state) {
        put_lane(state, parameters_.trunk_pinned, world % kLanes, groups_[world / kLanes]);
    }

    Actuation take_actions(int block, const float* actions);
    bool finish(int world, const Group& before, bool diverged, const StepArrays& arrays);
    void write(int world, const View& view, float* observation, float* features) const;
    void write_contact(int world, const View& view, bool* contact) const;

    Parameters parameters_;
    const ResetBank& bank_;
    NativeConstants constants_;
    int count_, size_, actions_;
    std::vector<Group> groups_;
    std::vector<Episode> episodes_;
    std::array<double, kWalkerState> idle_{};
};

Actuation NativeWorlds::take_actions(int block, const float* actions) {
    Actuation asked{};
    for (int world = first(block); world < last(block); ++world) {
        const int n = world % kLanes;
        Episode& episode = episodes_[world];
        ++episode.steps;
        for (int i = 0; i < actions_; ++i) {
            episode.previous_action[i] = std::clamp<double>(actions[actions_ * world + i], -1.0, 1.0);
        }
        for (int i = 0; i < kLegs; ++i) {
            const int slot = slot_of(groups_[block], n, i);
            asked.torque[slot][n] = parameters_.hip_torque * episode.previous_action[i];
            asked.drive[slot][n] = episode.previous_action[kLegs + i];
        }
    }
    return asked;
}

// Outcome of a step and what follows it: an autoreset, or another command. Tells if there was one.
bool NativeWorlds::finish(int world, const Group& before, bool diverged, const StepArrays& arrays) {
    Group& g = groups_[world / kLanes];
    const int n = world % kLanes;
    const double start = before.origin[n] + before.trunk.x[n];
    const double velocity = (g.origin[n] + g.trunk.x[n] - start) * parameters_.control_frequency;
    const double power = arrays.positive_power[world];
    const bool terminated = diverged || fallen(parameters_, g.trunk.y[n], -g.angle[n]);
    arrays.forward_velocity[world] = static_cast<float>(velocity);
    arrays.reward[world] = diverged ? 0.0F : static_cast<float>(reward(parameters_, episodes_[world].speed, velocity, power));
    arrays.diverged[world] = diverged;
    arrays.terminated[world] = terminated;
    arrays.truncated[world] = !terminated && episodes_[world].steps >= parameters_.episode_steps;
    const double force = parameters_.foot_mass * parameters_.control_frequency;
    for (int i = 0; i < kLegs; ++i) {
        const LegLanes& leg = g.leg[slot_of(g, n, i)];
        arrays.ground_force[kLegs * world + i] = static_cast<float>(force * leg.ground_impulse[n]);
        arrays.hip_torque[kLegs * world + i] = static_cast<float>(leg.hip_torque[n]);
    }
    const bool done = terminated || arrays.truncated[world];
    if (done) begin(world);
    return done || episodes_[world].take_command(parameters_, g.stiffness_share[n]);
}

// Lengths in leg lengths, speeds in sqrt(g L0), rates in sqrt(g / L0), forces in body weights.
void NativeWorlds::write(int world, const View& view, float* observation, float* features) const {
    const Group& g = groups_[world / kLanes];
    const int n = world % kLanes;
    const double length = parameters_.leg_length;
    const double gravity = parameters_.gravity > 0.0 ? parameters_.gravity : 1.0;
    const double speed = std::sqrt(gravity * length), rate = std::sqrt(gravity / length);
    float o[kMotorObservation];
    const auto put = [&o](int column, double value) { o[column] = static_cast<float>(value); };
    float* f = features + kFeatures * world;
    put(0, (g.origin[n] + g.trunk.x[n] - g.touchdown_x[n]) / length);
    put(1, g.trunk.y[n] / length);
    put(2, g.trunk.vx[n] / speed);
    put(3, g.trunk.vy[n] / speed);
    put(4, -g.angle[n]);
    put(5, -g.rate[n] / rate);
    f[0] = static_cast<float>(g.trunk.y[n]);
    for (int i = 0; i < kLegs; ++i) {
        const int k = slot_of(g, n, i);
        put(6 + i, view.length[k][n] / length - 1.0);
        put(8 + i, view.rate[k][n] / speed);
        put(10 + i, view.angle[k][n] - g.angle[n]);
        put(12 + i, (view.angle_rate[k][n] - g.rate[n]) / rate);
        put(14 + i, view.load[k][n] / (parameters_.mass * gravity));
        put(16 + i, episodes_[world].previous_action[i]);
        f[1 + 2 * i] = static_cast<float>(view.x[k][n]);
        f[2 + 2 * i] = static_cast<float>(view.y[k][n]);
    }
    put(18, episodes_[world].speed / speed);
    put(19, g.touchdown_side[n]);
    for (int i = 0; i < kLegs && constants_.has_motor; ++i) {
        const LegLanes& leg = g.leg[slot_of(g, n, i)];
        put(20 + i, leg.extension[n] / length);
        put(22 + i, leg.extension_rate[n] / speed);
        put(24 + i, episodes_[world].previous_action[kLegs + i]);
    }
    put(26, g.stiffness_share[n]);
    put(27, g.touchdown_age[n] * rate);
    put(28, std::sqrt(2.0 * episodes_[world].apex / length));
    write_observation(parameters_, o, observation + size_ * world);
}

void NativeWorlds::write_contact(int world, const View& view, bool* contact) const {
    const int n = world % kLanes;
    for (int i = 0; i < kLegs; ++i) {
        contact[kLegs * world + i] = view.contact[slot_of(groups_[world / kLanes], n, i)][n] > 0.0;
    }
}

}  // namespace

std::unique_ptr<Worlds> native_worlds(const Parameters& parameters, int worlds, const ResetBank& bank) {
    return std::make_unique<NativeWorlds>(parameters, worlds, bank);
}

}  // namespace romgrl
