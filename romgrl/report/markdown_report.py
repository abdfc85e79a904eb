"""report.md: the results of one run in words, tables and pictures, and how each number was obtained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from romgrl.gait.measures import MEANINGS
from romgrl.report.human_band_figure import human_table
from romgrl.report.tables import definitions, distance_table, error_table, gait_table, markdown, null_models_table

HOW_OBTAINED = {
    "error": "mean squared error per channel over the last {window} steps of every episode without a fall, laid over "
    "the window of the teacher's reference with the least error, all five channels shifted by the same time and "
    "weighted by their variance; mean over episodes. Nearest window of all episodes: sought in all of the reference; "
    "one shift within one episode: in one of its episodes at a time, mean over them; no shift: its first window",
    "teacher floor": "the same error of the teacher's episodes against its other episodes",
    "other teacher": "the teacher that ships, trained with another seed, on the same reduced-order model",
    "teacher, stretched": "the teacher played at the student's cadence, against its other episodes",
    "sinusoid": "no body, but cosines at the teacher's cadence with its means, amplitudes and phases; where the feet "
    "take turns, they are in antiphase and the pelvis is at twice the cadence",
    "statue": "a body frozen in the teacher's mean pose",
    "mmd": "squared maximum mean discrepancy (unbiased, so it can be below zero) between the scored windows and the "
    "teacher's, over runs of four frames in the teacher's standard deviations; Gaussian kernel, the teacher's median "
    "distance as its width; p: share of 2,000 exchanges of whole episodes that give as much",
    "wasserstein": "first Wasserstein distance between the values of a channel, whenever they came; all channels: mean "
    "in standard deviations of the teacher",
    "dtw": "what dynamic time warping within 10 % of the window leaves over the nearest window of all episodes, one "
    "warping for all channels: mean distance along it, all channels together in standard deviations of the teacher",
    "reduction": "100 (1 - student / baseline); the average is the mean of the five reductions, as in the paper",
    **MEANINGS,
}

NULL_MODELS_SAID = (
    "Student and baseline beside walkers that learned nothing, all scored in the same way. A number that a statue has, "
    "too, says nothing of a gait; the teacher against itself is the best that can be hoped for."
)


@dataclass(frozen=True)
class Facts:
    """What the document says of the run besides its tables."""

    speed: float
    teacher_speed: float
    eta: float
    noise: float
    seed: int
    episodes: int
    steps: int
    window: int
    wall_times: Mapping[str, float]


def document(
    errors: pd.DataFrame,
    distances: pd.DataFrame,
    gaits: pd.DataFrame,
    nulls: pd.DataFrame,
    facts: Facts,
    pictures: Sequence[str],
    films: Sequence[str],
) -> str:
    """The whole document; pictures and films are names of files beside it."""
    parts = [
        f"# Gait at {facts.speed:g} m/s\n\n{summary(errors, gaits)}\n",
        setup_of(facts) + "\n",
        f"## Error against the teacher\n\n{markdown(error_table(errors))}\n{remarks(errors)}",
        "## Distance from the teacher\n\nBy measures that no training has seen.\n\n"
        + markdown(distance_table(distances)),
        f"## What a null model scores\n\n{NULL_MODELS_SAID}\n\n{markdown(null_models_table(nulls))}",
        f"## Gait\n\n{markdown(gait_table(gaits))}",
        f"## Human adults at this speed\n\n{humans(facts.speed)}",
        "## Pictures\n\n" + "\n\n".join(f"![{name}]({name}.png)" for name in pictures) + "\n",
    ]
    if films:
        parts.append("## Films\n\n" + "\n".join(f"- [{name}]({name})" for name in films) + "\n")
    parts.append(f"## How the numbers were obtained\n\n{definitions(meanings(facts))}")
    if facts.wall_times:
        times = pd.DataFrame({"stage": list(facts.wall_times), "wall time [s]": list(facts.wall_times.values())})
        parts.append(f"## Time\n\n{markdown(times)}")
    return "\n".join(parts)


def setup_of(facts: Facts) -> str:
    """What was trained and how it was measured."""
    return (
        f"Student: eta = {facts.eta:g}, noise = {facts.noise:g}; teacher trained for {facts.teacher_speed:g} m/s; "
        f"{facts.episodes} episodes of {facts.steps} steps per walker, both from the same resets; seed {facts.seed}, "
        "one training each: another seed gives other numbers."
    )


def meanings(facts: Facts) -> dict[str, str]:
    """How each number was obtained."""
    values = {"window": facts.window, "steps": facts.steps}
    return {name: text.format(**values) for name, text in HOW_OBTAINED.items()}


def humans(speed: float) -> str:
    """The bands of human adults with their sources, or that there are none."""
    table = human_table(speed)
    return markdown(table) if len(table) else f"No published numbers are kept for {speed:g} m/s.\n"


def summary(errors: pd.DataFrame, gaits: pd.DataFrame) -> str:
    """The result in two sentences."""
    rows = gaits.set_index("walker")
    said = [
        f"{name} upright in {row.episodes - row.falls:.0f} of {row.episodes:.0f} episodes at "
        f"{row.steady_speed_m_per_s:.2f} m/s with a trunk lean of {row.trunk_lean_deg:.0f} degrees"
        for name, row in rows.loc[["student", "baseline"]].iterrows()
    ]
    walkers = f"{said[0].capitalize()}; {said[1]}."
    average = errors[(errors.channel == "average") & (errors.alignment == "aligned")].iloc[0]
    if average.note != "ok":
        return f"The error against the teacher is {average.note}. {walkers}"
    verb = "below" if average.reduction_percent >= 0 else "above"
    return (
        f"The student's error against the teacher is on average {abs(average.reduction_percent):.1f} % {verb} the "
        f"baseline's. {walkers}"
    )


def remarks(errors: pd.DataFrame) -> str:
    """What the table leaves out: episodes that count, and the reduction of the averaged error."""
    average = errors[(errors.channel == "average") & (errors.alignment == "aligned")].iloc[0]
    counted = f"Episodes counted: student {average.student_episodes}, baseline {average.baseline_episodes}."
    if average.note != "ok":
        return f"{counted} {average.note}.\n"
    pooled = 100.0 * (1.0 - average.student / average.baseline)
    return f"{counted} The averaged error, which the feet's x rule, is reduced by {pooled:.1f} %.\n"
