"""The measures of a gait: one row for each number of gait.csv, read by tables, figures, reports, MLflow and sweeps.

`romgrl.gait.metrics.describe` computes them; a new one is a row here and a value there.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Measure:
    """What a number is called, its unit and decimals, which way is better ("higher", "lower", None), what it means.

    `swept`: sweeps summarise it over seeds for every walker. `panel`: reports draw it beside what people do.
    """

    label: str
    unit: str = ""
    decimals: int = 3
    better: str | None = None
    swept: bool = False
    panel: bool = False
    meaning: str | None = None

    @property
    def title(self) -> str:
        """The label with its unit, as in `mean speed [m/s]`."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


MEASURES = {
    "episodes": Measure("episodes", decimals=0),
    "falls": Measure(
        "falls",
        decimals=0,
        better="lower",
        meaning="episodes that ended before {steps} steps by a fall; what follows a fall counts nowhere",
    ),
    "falls_percent": Measure("falls", "%", 1, "lower", swept=True),
    "target_speed_m_per_s": Measure("target speed", "m/s", 2),
    "mean_speed_m_per_s": Measure(
        "mean speed",
        "m/s",
        2,
        swept=True,
        meaning="over all steps from the reset, which starts slower than the target, and so its error; steady speed "
        "and all numbers of the gait: from 4 s on",
    ),
    "steady_speed_m_per_s": Measure("steady speed", "m/s", 2, swept=True),
    "speed_error_percent": Measure("speed error", "%", 1, "lower", swept=True),
    "stride_frequency_hz": Measure(
        "stride frequency",
        "Hz",
        2,
        swept=True,
        panel=True,
        meaning="forward swings of each foot per second, median over episodes",
    ),
    "stride_length_m": Measure("stride length", "m", panel=True),
    "duty_factor": Measure(
        "duty factor",
        swept=True,
        panel=True,
        meaning="share of a stride that a foot touches the ground, from the contacts; below 0.5 it is a run",
    ),
    "left_right_correlation": Measure(
        "left right correlation", meaning="Pearson correlation of both feet's x: -1 alternates, +1 hops"
    ),
    "left_right_symmetry": Measure(
        "left right symmetry",
        better="higher",
        swept=True,
        meaning="Lin's concordance of left foot x with right foot x at the best time shift: 1 is symmetric",
    ),
    "touchdown_phase_strides": Measure(
        "touchdown phase", "strides", meaning="of the right foot within the left foot's stride: 0.5 alternates"
    ),
    "pelvis_height_m": Measure("pelvis height", "m"),
    "pelvis_excursion_m": Measure(
        "pelvis excursion", "m", swept=True, panel=True, meaning="highest minus lowest pelvis within a stride"
    ),
    "trunk_lean_deg": Measure(
        "trunk lean",
        "deg",
        1,
        swept=True,
        meaning="of the line from pelvis to neck against the vertical, forward positive",
    ),
    "cost_of_transport": Measure(
        "cost of transport",
        better="lower",
        swept=True,
        meaning="mechanical: sum over joints of |torque x angular velocity| / (m g v), stops included; of "
        "the teacher hip motors and retraction of the legs, but not its springs and dampers",
    ),
    "cost_without_retraction": Measure(
        "cost of transport without retraction",
        better="lower",
        meaning="of the teacher, hip motors alone: what shortens a leg in its swing is scripted, not the policy's",
    ),
    "positive_power_w_per_kg": Measure(
        "positive power",
        "W/kg",
        1,
        "lower",
        swept=True,
        panel=True,
        meaning="of actuators and stops, where torque and angular velocity have the same sign, over the body mass; of "
        "the teacher hip motors and retraction, so that what its springs give back does not count",
    ),
    "positive_power_without_retraction_w_per_kg": Measure(
        "positive power without retraction", "W/kg", 1, "lower", meaning="of the teacher, hip motors alone"
    ),
    "stop_torque_share": Measure(
        "stop torque",
        better="lower",
        meaning="largest torque of a joint's stop as a share of its actuator's largest torque",
    ),
    "ankle_stop_percent": Measure(
        "ankle on a stop", "%", 1, "lower", swept=True, meaning="share of the time that the foot touches the ground"
    ),
    "contact_bouts": Measure(
        "contact bouts",
        decimals=2,
        better="lower",
        meaning="touchdowns per stance at the rate of the physics: more than 1 where a foot chatters",
    ),
    "sliding_percent": Measure(
        "sliding",
        "%",
        1,
        "lower",
        meaning="share of the time that a foot bears more than a tenth of the body weight in which it slides at more "
        "than 0.3 m/s",
    ),
    "step_time_asymmetry_percent": Measure(
        "step time asymmetry",
        "%",
        1,
        "lower",
        swept=True,
        meaning="difference of the times of left and right steps over their mean",
    ),
    "error_over_variance": Measure(
        "error over variance",
        better="lower",
        swept=True,
        meaning="mean squared error over the reference's variance, one time shift within one episode of the reference, "
        "mean over its episodes and the five channels: 0 is the teacher, 1 a statue in its mean pose",
    ),
    "largest_error_over_variance": Measure(
        "error over variance, worst channel", better="lower", meaning="the same for the channel where it is largest"
    ),
    "jumps": Measure("jumps", decimals=0),
    "jump_apex_m": Measure("jump apex", "m", meaning="highest body in a flight over its height on straight legs"),
    "jump_apex_error_m": Measure(
        "jump apex error", "m", better="lower", meaning="mean distance of the apexes from the one asked for"
    ),
    "phase_lag_s": Measure(
        "phase lag",
        "s",
        better="lower",
        meaning="time shift of each foot's x that is left after the common alignment, mean of its absolute value; "
        "says little where the stride frequencies differ",
    ),
    "phase_lag_strides": Measure("phase lag", "strides", better="lower"),
}
"""By column of gait.csv; falls_percent and stride_length_m follow from others."""
PANELS = tuple(name for name, measure in MEASURES.items() if measure.panel)
SWEPT = tuple(name for name, measure in MEASURES.items() if measure.swept)
MEANINGS = {measure.label: measure.meaning for measure in MEASURES.values() if measure.meaning is not None}
