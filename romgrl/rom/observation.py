"""Observation layout of the spring-leg model and its left-right mirror image."""

from __future__ import annotations

from romgrl.gait.symmetry import Mirror, by_name, left_or_right

# Lengths are in leg lengths L0, speeds in sqrt(g L0), rates in sqrt(g / L0), loads in body weights, angles in rad;
# pitch and hip angle are positive forward.
OBSERVATION_NAMES: tuple[str, ...] = (
    "distance_since_touchdown",
    "height",
    "forward_velocity",
    "vertical_velocity",
    "pitch",
    "pitch_rate",
    "left_leg_strain",
    "right_leg_strain",
    "left_extension_rate",
    "right_extension_rate",
    "left_hip_angle",
    "right_hip_angle",
    "left_hip_rate",
    "right_hip_rate",
    "left_load",
    "right_load",
    "left_previous_action",
    "right_previous_action",
    "target_speed",
    "last_touchdown_side",
)
MOTOR_OBSERVATION_NAMES = (
    *OBSERVATION_NAMES,
    "left_rest_extension",
    "right_rest_extension",
    "left_rest_rate",
    "right_rest_rate",
    "left_previous_drive",
    "right_previous_drive",
    "stiffness_share",
    "time_since_touchdown",
    "target_takeoff_velocity",
)
"""With a motor in each leg: the rest length beyond L0, its rate, the last drive; a time, in sqrt(L0 / g); how fast a
jump to the apex asked for passes the height that apexes are measured from, sqrt(2 g h)."""
PAPER_COLUMNS: tuple[int, ...] = (0, 1, 2, 3, 6, 7, 8, 9, 10, 11, 12, 13, 18)


def mirror(names: tuple[str, ...]) -> Mirror:
    """Mirror image of columns of these names: left and right exchanged; a side that is told as a number is negated."""
    return by_name(names, left_or_right, negated={"last_touchdown_side"}.intersection(names))


PAPER_OBSERVATION_NAMES = tuple(OBSERVATION_NAMES[column] for column in PAPER_COLUMNS)
ACTION_NAMES = ("left_hip", "right_hip")
MOTOR_ACTION_NAMES = (*ACTION_NAMES, "left_leg", "right_leg")
