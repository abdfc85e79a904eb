#include "rom/parameters.hpp"

#include <cmath>
#include <sstream>
#include <stdexcept>

namespace romgrl {
namespace {

void require(bool condition, const std::string& message) {
    if (!condition) throw std::invalid_argument(message);
}

void in_range(const char* name, double value, double low, double high) {
    if (value >= low && value <= high) return;  // false for NaN
    std::ostringstream text;
    text << name << " = " << value << " is not between " << low << " and " << high;
    throw std::invalid_argument(text.str());
}

// A leg in flight is a damped oscillator of the reduced mass of foot and trunk. Semi-implicit Euler with an explicit
// damper is stable if omega^2 dt^2 < 4 - 2 (c / m) dt.
void require_stable(const Parameters& p) {
    const double trunk = p.mass - 2.0 * p.foot_mass;
    const double reduced = p.foot_mass * trunk / (p.foot_mass + trunk);
    const double dt = p.substep_time();
    const double damping = std::fmax(p.swing_damping, p.stance_damping);
    if (p.stiffness / reduced * dt * dt < 4.0 - 2.0 * damping / reduced * dt) return;
    std::ostringstream text;
    text << "stiffness " << p.stiffness << " N/m and damping " << damping << " N s/m cannot be integrated with foot_mass "
         << p.foot_mass << " kg at " << dt << " s per substep: raise substeps";
    throw std::invalid_argument(text.str());
}

void validate_task(const Parameters& p) {
    in_range("reset_hip_angle[0]", p.reset_hip_angle_low, 0.0, p.hip_angle_limit);
    in_range("reset_hip_angle[1]", p.reset_hip_angle_high, p.reset_hip_angle_low, p.hip_angle_limit);
    in_range("reset_speed[0]", p.reset_speed_low, -10.0, 10.0);
    in_range("reset_speed[1]", p.reset_speed_high, p.reset_speed_low, 10.0);
    in_range("speed", p.speed, 0.0, 10.0);
    in_range("episode_steps", p.episode_steps, 1, 1e9);
    in_range("alpha", p.alpha, 1e-9, 1e6);
}

}  // namespace

void validate(const Parameters& p) {
    in_range("mass", p.mass, 1e-2, 1e6);
    in_range("foot_mass", p.foot_mass, 1e-4, 1e5);
    require(2.0 * p.foot_mass < p.mass, "mass must exceed the mass of both feet");
    in_range("leg_length", p.leg_length, 0.05, 2.0);
    in_range("foot_radius", p.foot_radius, 1e-3, 1.0);
    in_range("stiffness", p.stiffness, 1e-3, 1e9);
    in_range("stance_damping", p.stance_damping, 0.0, 1e7);
    in_range("swing_damping", p.swing_damping, 0.0, 1e7);
    in_range("hip_torque", p.hip_torque, 0.0, 1e5);
    in_range("torque_lag", p.torque_lag, 0.0, 100.0);
    in_range("trunk_moment_limit", p.trunk_moment_limit, 0.0, std::numeric_limits<double>::infinity());
    in_range("retraction", p.retraction, 0.0, 0.4);
    in_range("retraction_time", p.retraction_time, 1e-6, 100.0);
    in_range("hip_angle_limit", p.hip_angle_limit, 0.01, 1.57);
    in_range("compression_limit", p.compression_limit, 0.05, 1.0);
    in_range("extension_limit", p.extension_limit, 1.0, 1.5);
    require(p.compression_limit < p.extension_limit, "compression_limit must be below extension_limit");
    in_range("friction", p.friction, 0.0, 100.0);
    in_range("trunk_inertia", p.trunk_inertia, 1e-4, 1e6);
    in_range("trunk_pitch_limit", p.trunk_pitch_limit, 0.01, 10.0);
    in_range("fall_height", p.fall_height, 0.0, 1.0);
    in_range("substeps", p.substeps, 1, 10000);
    in_range("velocity_iterations", p.velocity_iterations, 1, 1000);
    in_range("position_iterations", p.position_iterations, 1, 1000);
    in_range("gravity", p.gravity, 0.0, 100.0);
    in_range("control_frequency", p.control_frequency, 1.0, 10000.0);
    require_stable(p);
    validate_task(p);
}

}  // namespace romgrl
