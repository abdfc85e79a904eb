#include "humanoid/planar_bodies.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace romgrl {

namespace {

struct Turn {
    double cosine, sine;

    // A positive angle about y turns z towards x.
    Vector apply(const Vector& v) const { return {cosine * v[0] + sine * v[2], v[1], cosine * v[2] - sine * v[0]}; }
};

struct Motion {
    double angle, rate;  // of the orientation since rest
    Turn turn;
    Vector position, velocity;
};

// Writes a vector as seen from the heading frame, which is the world or the world turned by half a turn about z.
float* put(float* out, const Vector& v, double heading) {
    out[0] = static_cast<float>(heading * v[0]);
    out[1] = static_cast<float>(heading * v[1]);
    out[2] = static_cast<float>(v[2]);
    return out + 3;
}

}  // namespace

PlanarBodies::PlanarBodies(std::vector<Body> bodies, Landmarks landmarks, std::vector<SolePoint> soles,
                           std::vector<double> rest)
    : bodies_(std::move(bodies)), landmarks_(landmarks), soles_(std::move(soles)), rest_(std::move(rest)) {
    if (size() < 1 || size() > kMostBodies) throw std::invalid_argument("there must be 1 to 64 bodies");
    for (int i = 0; i < size(); ++i) {
        const Body& body = bodies_[i];
        const bool ordered = i == 0 ? body.parent == -1 : body.parent >= 0 && body.parent < i;
        if (!ordered) throw std::invalid_argument("a parent must come before its children");
        if (body.joint < -1 || body.joint >= joints()) throw std::invalid_argument("no such joint");
    }
    for (const int body : {landmarks_.left_ankle, landmarks_.right_ankle, landmarks_.neck, landmarks_.head}) {
        if (body < 0 || body >= size()) throw std::invalid_argument("no such body");
    }
    for (const SolePoint& point : soles_) {
        if (point.body < 0 || point.body >= size()) throw std::invalid_argument("no such body");
    }
    for (const bool left : {true, false}) {
        const auto there = [left](const SolePoint& point) { return point.left == left; };
        if (std::none_of(soles_.begin(), soles_.end(), there)) throw std::invalid_argument("each foot needs a sole");
    }
    if (joints() < 2) throw std::invalid_argument("the first body must move along x and z");
}

double PlanarBodies::fastest(const double* qpos, const double* qvel) const {
    double largest = 0.0;
    for (int i = 0; i < joints(); ++i) {
        if (!std::isfinite(qpos[i]) || !std::isfinite(qvel[i])) return std::numeric_limits<double>::infinity();
        largest = std::max(largest, std::abs(qvel[i]));
    }
    return largest;
}

Posture PlanarBodies::observe(const double* qpos, const double* qvel, float* __restrict observation) const {
    const int count = size();
    std::array<Motion, kMostBodies> motions;  // nothing else points to it, unlike a vector: a quarter faster
    motions[0] = {0.0, 0.0, {1.0, 0.0}, bodies_[0].offset, {qvel[kRootX], 0.0, qvel[kRootZ]}};
    motions[0].position[0] += qpos[kRootX] - rest_[kRootX];
    motions[0].position[2] += qpos[kRootZ] - rest_[kRootZ];
    for (int i = 0; i < count; ++i) {
        const Body& body = bodies_[i];
        Motion& motion = motions[i];
        if (i > 0) {
            const Motion& parent = motions[body.parent];
            const Vector arm = parent.turn.apply(body.offset);
            motion = parent;
            for (int k = 0; k < 3; ++k) motion.position[k] += arm[k];
            motion.velocity[0] += parent.rate * arm[2];
            motion.velocity[2] -= parent.rate * arm[0];
        }
        if (body.joint >= 0) {
            motion.angle += qpos[body.joint] - rest_[body.joint];
            motion.rate += qvel[body.joint];
            motion.turn = {std::cos(motion.angle), std::sin(motion.angle)};
        }
    }

    const Motion& pelvis = motions[0];
    const double heading = pelvis.turn.cosine < 0.0 ? -1.0 : 1.0;
    float* out = observation;
    *out++ = static_cast<float>(pelvis.position[2]);
    for (int i = 1; i < count; ++i) {
        const Vector& origin = motions[i].position;
        out = put(out, {origin[0] - pelvis.position[0], origin[1] - pelvis.position[1], origin[2] - pelvis.position[2]},
                  heading);
    }
    for (int i = 0; i < count; ++i) {
        out = put(out, motions[i].turn.apply(bodies_[i].x_axis), heading);
        out = put(out, motions[i].turn.apply(bodies_[i].z_axis), heading);
    }
    for (int i = 0; i < count; ++i) out = put(out, motions[i].velocity, heading);
    for (int i = 0; i < count; ++i) out = put(out, {0.0, motions[i].rate, 0.0}, heading);

    double left_sole = std::numeric_limits<double>::infinity(), right_sole = left_sole;
    for (const SolePoint& point : soles_) {
        const Motion& motion = motions[point.body];
        double& lowest = point.left ? left_sole : right_sole;
        lowest = std::min(lowest, motion.position[2] + motion.turn.apply(point.offset)[2] - point.radius);
    }

    const auto above = [&](int body, int axis) { return motions[body].position[axis] - pelvis.position[axis]; };
    return {pelvis.position[2],
            above(landmarks_.left_ankle, 0),
            above(landmarks_.left_ankle, 2),
            above(landmarks_.right_ankle, 0),
            above(landmarks_.right_ankle, 2),
            std::atan2(above(landmarks_.neck, 0), above(landmarks_.neck, 2)),
            motions[landmarks_.head].position[2],
            fastest(qpos, qvel),
            left_sole,
            right_sole};
}

}  // namespace romgrl
