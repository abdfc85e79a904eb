// Kinematics of a tree of bodies that moves in the x-z plane: the orientation of a body is one angle about y.
//
// Positions, velocities and the observation follow from joint angles alone, at a tenth of the cost of MuJoCo's pass over the
// new state, which looks for contacts too.
#pragma once

#include <array>
#include <vector>

namespace romgrl {

using Vector = std::array<double, 3>;

constexpr int kBodies = 24;
constexpr int kObservation = 358;
constexpr int kRootX = 0, kRootZ = 1;  // columns of qpos and qvel

struct Body {
    int parent;          // -1: the first body, which moves along x and z
    int joint;           // column of its pitch angle in qpos and qvel; -1: welded to its parent
    Vector offset;       // origin relative to the parent's (of the first body: to the world's), all angles at rest
    Vector x_axis, z_axis;  // local axes, all angles at rest
};

class PlanarBodies {
  public:
    // rest: qpos of the pose in which offsets and axes were taken.
    PlanarBodies(std::vector<Body> bodies, std::vector<double> rest);

    int joints() const { return static_cast<int>(rest_.size()); }

    // HumEnv's observation (kObservation) and the origins (kBodies x 3) of one state.
    void observe(const double* qpos, const double* qvel, float* observation, double* position) const;

  private:
    std::vector<Body> bodies_;
    std::vector<double> rest_;
};

}  // namespace romgrl
