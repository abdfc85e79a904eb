// Kinematics of a tree of bodies that moves in the x-z plane: the orientation of a body is one angle about y.
//
// Positions, velocities and the observation follow from joint angles alone, at a tenth of the cost of MuJoCo's pass over the
// new state, which looks for contacts too.
#pragma once

#include <array>
#include <vector>

namespace romgrl {

using Vector = std::array<double, 3>;

constexpr int kMostBodies = 64;
constexpr int kRootX = 0, kRootZ = 1;  // columns of qpos and qvel

struct Body {
    int parent;          // -1: the first body, which moves along x and z
    int joint;           // column of its pitch angle in qpos and qvel; -1: welded to its parent
    Vector offset;       // origin relative to the parent's (of the first body: to the world's), all angles at rest
    Vector x_axis, z_axis;  // local axes, all angles at rest
};

// The bodies that a posture is measured at, beside the first one, the pelvis.
struct Landmarks {
    int left_ankle, right_ankle, neck, head;
};

// What a foot stands on: a ball of its sole, or a corner, which has no radius.
struct SolePoint {
    int body;
    bool left;
    Vector offset;  // from the body's origin, all angles at rest
    double radius;
};

// Heights above the ground, ankles relative to the pelvis, the lean of the line from pelvis to neck (forward positive), the
// largest joint speed, infinite where a joint value is not finite, and the heights of the lowest points of both soles.
struct Posture {
    double pelvis_height, left_forward, left_up, right_forward, right_up, trunk_lean, head_height, fastest, left_sole,
        right_sole;
};
constexpr int kPosture = 10;
static_assert(sizeof(Posture) == kPosture * sizeof(double));

class PlanarBodies {
  public:
    // rest: qpos of the pose in which offsets and axes were taken, facing forward.
    PlanarBodies(std::vector<Body> bodies, Landmarks landmarks, std::vector<SolePoint> soles, std::vector<double> rest);

    int joints() const { return static_cast<int>(rest_.size()); }
    int size() const { return static_cast<int>(bodies_.size()); }

    // Height; positions of all bodies but the first; two axes and two velocities of each.
    int observation_size() const { return 1 + 3 * (size() - 1) + 12 * size(); }

    // Writes HumEnv's observation (observation_size) of one state and returns its posture.
    Posture observe(const double* qpos, const double* qvel, float* observation) const;

  private:
    double fastest(const double* qpos, const double* qvel) const;

    std::vector<Body> bodies_;
    Landmarks landmarks_;
    std::vector<SolePoint> soles_;
    std::vector<double> rest_;
};

}  // namespace romgrl
