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
    const double stiffness = p.stiffness * p.stiffness_share_high;
    if (stiffness / reduced * dt * dt < 4.0 - 2.0 * damping / reduced * dt) return;
    std::ostringstream text;
    text << "stiffness " << stiffness << " N/m and damping " << damping << " N s/m cannot be integrated with foot_mass "
         << p.foot_mass << " kg at " << dt << " s per substep: raise substeps";
    throw std::invalid_argument(text.str());
}

// The carriage of a leg's motor: semi-implicit Euler as above, with all that resists its speed as damping.
void require_leg_motor(const Parameters& p) {
    if (!p.leg_motor) return;
    require(!p.observation_is_paper, "observation: the paper's has no leg motor");
    require(p.shortest_rest > p.compression_limit, "shortest_rest must exceed compression_limit");
    require(p.longest_rest < p.extension_limit, "longest_rest must be below extension_limit");
    const double dt = p.substep_time(), stiffness = p.stiffness * p.stiffness_share_high;
    const double slope = std::fmax(1.0 / p.motor_speed, (p.motor_eccentric - 1.0) / p.motor_eccentric_speed);
    const double damping = p.motor_force * slope + p.motor_damping + std::fmax(p.swing_damping, p.stance_damping);
    if (stiffness / p.motor_mass * dt * dt < 4.0 - 2.0 * damping / p.motor_mass * dt) return;
    std::ostringstream text;
    text << "motor_mass " << p.motor_mass << " kg cannot be integrated with motor_force " << p.motor_force << " N at " << dt
         << " s per substep: raise motor_mass or substeps";
    throw std::invalid_argument(text.str());
}

// The arc's centre is on the leg, even on the shortest one.
void require_roll_over(const Parameters& p) {
    if (p.roll_over_radius == 0.0) return;
    in_range("roll_over_radius", p.roll_over_radius, p.foot_radius, p.foot_radius + p.compression_limit * p.leg_length);
}

void require_commands(const Parameters& p) {
    in_range("speed_high", p.speed_high, p.speed_low, 10.0);
    in_range("stiffness_share_high", p.stiffness_share_high, p.stiffness_share_low, 10.0);
    in_range("apex_high", p.apex_high, p.apex_low, 2.0);
}

void require_resets(const Parameters& p) {
    in_range("reset_hip_angle[0]", p.reset_hip_angle_low, 0.0, p.hip_angle_limit);
    in_range("reset_hip_angle[1]", p.reset_hip_angle_high, p.reset_hip_angle_low, p.hip_angle_limit);
    in_range("reset_speed[0]", p.reset_speed_low, -10.0, 10.0);
    in_range("reset_speed[1]", p.reset_speed_high, p.reset_speed_low, 10.0);
    in_range("reset_drop[0]", p.reset_drop_low, 0.0, 2.0);
    in_range("reset_drop[1]", p.reset_drop_high, p.reset_drop_low, 2.0);
}

}  // namespace

void validate(const Parameters& p) {
#define ROW(type, name, value, least, most) in_range(#name, p.name, least, most);
    ROMGRL_PARAMETERS(ROW)
#undef ROW
    require(2.0 * p.foot_mass < p.mass, "mass must exceed the mass of both feet");
    require(p.compression_limit < p.extension_limit, "compression_limit must be below extension_limit");
    require_roll_over(p);
    require_stable(p);
    require_leg_motor(p);
    require_commands(p);
    require_resets(p);
}

}  // namespace romgrl
