// A trunk on two spring legs in Box2D: forces, contact and state. Knows nothing of episodes or rewards.
//
// Signs: angles are positive forward. The world angle of a leg is theta = atan2(dx, -dy) of the vector from hip to foot;
// pitch is positive when the trunk leans forward (Box2D's angle is -pitch); hip angle = theta + pitch. A positive hip
// torque swings the leg forward. Left is leg 0, right is leg 1.
#pragma once

#include <array>
#include <memory>

#include <box2d/box2d.h>

#include "rom/arc_foot.hpp"
#include "rom/leg_motor.hpp"
#include "rom/work.hpp"
#include "rom/world_state.hpp"

namespace romgrl {

struct LegView {
    double length, rate;  // m, m/s
    double angle, angle_rate;  // theta, in the world: rad, rad/s
    double along_x, along_y;  // unit vector from hip to foot; (-along_y, along_x) points to larger angles
    double height;  // foot centre above ground, m
    bool contact;  // the foot's circle or arc touches the ground
};

class Walker {
  public:
    explicit Walker(const Parameters& parameters);

    // One control step with hip torques in N m and the drives of the legs' motors. False: the state left the numbers that
    // Box2D can take.
    bool step(const std::array<double, kLegs>& asked, const std::array<double, kLegs>& drive);

    LegView leg(int side) const;
    double x() const { return origin_ + trunk_->GetPosition().x; }
    double y() const { return trunk_->GetPosition().y; }
    double vx() const { return trunk_->GetLinearVelocity().x; }
    double vy() const { return trunk_->GetLinearVelocity().y; }
    double pitch() const { return -trunk_->GetAngle(); }
    double pitch_rate() const { return -trunk_->GetAngularVelocity(); }
    double axial_force(int side, const LegView& view) const;  // spring and damper, positive pushes apart, N
    bool loaded(int side, const LegView& view) const;  // on the ground and compressed

    const std::array<double, kLegs>& ground_force() const { return ground_force_; }  // mean of the last step, N
    const std::array<double, kLegs>& hip_torque() const { return hip_torque_; }  // of the last substep, N m
    const Work& work() const { return work_; }  // of the last step
    double extension(int side) const { return motion_[side].extension; }  // of the rest length, m
    double extension_rate(int side) const { return motion_[side].extension_rate; }
    double stiffness_share() const { return stiffness_share_; }
    void set_stiffness_share(double share) { stiffness_share_ = share; }
    double last_touchdown_x() const { return last_touchdown_x_; }
    double touchdown_age() const { return touchdown_age_; }  // s since the last touchdown
    int last_touchdown_side() const { return last_touchdown_side_; }  // 1 left, -1 right, 0 none

    void save(double* state) const;
    void restore(const double* state);  // numbers of which is_walker_state() holds
    void place(const double* state);  // the same, and no step has been taken

  private:
    struct Motion {
        double torque = 0.0;  // motor, after its lag
        double shortening = 0.0;  // retraction of the rest length, m
        double touchdown_angle = 0.0;
        bool airborne = true;  // left the ground since it was last loaded
        double extension = 0.0, extension_rate = 0.0, drive = 0.0;  // see LegMotor
    };

    b2Body* foot(int side) const { return feet_[slot_[side]]; }
    double rest_length(int side) const {
        return parameters_.leg_length - motion_[side].shortening + motion_[side].extension;
    }
    bool update_touchdown(int side, const LegView& view, bool is_loaded);
    double update_shortening(int side, const LegView& view, bool other_loaded);
    double stop_torque(const LegView& view) const;
    bool substep(const std::array<double, kLegs>& asked, const std::array<double, kLegs>& drive);
    void update_motor(int side, double drive, double axial);
    void roll_feet(const std::array<LegView, kLegs>& view, const std::array<b2Vec2, kLegs>& force);
    void lift_feet(const std::array<LegView, kLegs>& before);
    void add_ground_force();
    void add_hip_work(const std::array<LegView, kLegs>& before, double pitch_rate_before);
    void recentre();
    bool sane() const;

    Parameters parameters_;
    LegMotor motor_;
    ArcFoot arc_;
    double dt_, lag_gain_, stiffness_share_ = 1.0;
    b2World world_;
    b2Body* trunk_ = nullptr;
    std::array<b2Body*, kLegs> feet_{};
    std::array<b2DistanceJoint*, kLegs> stops_{};
    std::array<int, kLegs> slot_{0, 1};
    std::array<Motion, kLegs> motion_{};
    std::array<double, kLegs> ground_force_{}, hip_torque_{};
    Work work_;
    double origin_ = 0.0;  // world x of Box2D's origin
    double last_touchdown_x_ = 0.0, touchdown_age_ = 0.0;
    int last_touchdown_side_ = 0;
};

}  // namespace romgrl
