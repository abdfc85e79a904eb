"""How runs are called and described in MLflow, so that a list of them can be read and one leads to the next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from romgrl.artifacts import Manifest
from romgrl.config.commanded import is_conditioned
from romgrl.config.schema import Config
from romgrl.config.values import value_of
from romgrl.provenance.stage_graph import KNOBS, STAGES, upstream_of
from romgrl.provenance.stage_keys import stage_config
from romgrl.report.markdown_table import markdown_table
from romgrl.report.numbers import significant
from romgrl.report.terminal_tables import run_link
from romgrl.results.sweep_record import settings
from romgrl.runtime.stage_log import format_duration

Overrides = Sequence[str]


def stage_title(stage: str, config: Config, overrides: Overrides) -> str:
    """`student v=4 eta=0.5 noise=0.05 s=0`, and what else was chosen that the stage depends on.

    What follows commands has no speed in its title, unless it begins with one.
    """
    follows, knobs = is_conditioned(config), dict(STAGES[stage].knobs)
    if follows and STAGES[stage].conditioned is not None and "speed" not in STAGES[stage].asks:
        del knobs["speed"]
    roots = {
        key
        for name in upstream_of(stage, conditioned=follows) | {stage}
        for key in STAGES[name].depends_on(conditioned=follows)
    }
    chosen = {
        key: value
        for key, value in settings(overrides).items()
        if any(key == root or key.startswith(f"{root}.") or root.startswith(f"{key}.") for root in roots)
    }
    return title_of(stage, knobs, stage_config(stage, config), chosen)


def job_title(name: str, config: Config, overrides: Overrides) -> str:
    """`job v=4 eta=0.5 noise=0.05 s=0` and what else was chosen; `name` where the job was given one."""
    return title_of(name if "=" not in name else "job", KNOBS, config, settings(overrides))


def title_of(first: str, knobs: Mapping[str, str], config: Config, chosen: Mapping[str, str]) -> str:
    """A title of the knobs, and of the chosen settings that are none."""
    shown = [f"{label}={value_of(config, key):g}" for key, label in knobs.items()]
    rest = [f"{key}={value}" for key, value in chosen.items() if key not in KNOBS and key not in knobs]
    return " ".join([first, *shown, *rest])


def stage_note(title: str, stage: str, key: str, upstream: Mapping[str, Manifest]) -> str:
    """The description of a stage's run, in Markdown: what it is, and the runs that made what it reads."""
    lines = [f"**{title}**", "", f"Artifact `{stage}/{key}`."]
    if upstream:
        lines += ["", "Made from:", ""]
        lines += [f"- {run_link(name, each.run_id)} `{each.key}`" for name, each in upstream.items()]
    return "\n".join(lines)


def job_note(
    title: str, made: Mapping[str, Manifest], reused: Mapping[str, Manifest], numbers: Mapping[str, float]
) -> str:
    """The description of a job's run, in Markdown: its stages with links to their runs, and the numbers that matter."""
    rows = []
    for stage in (stage for stage in STAGES if stage in made):
        each, how = made[stage], "reused" if stage in reused else "made"
        rows.append((run_link(stage, each.run_id), how, format_duration(each.wall_time), f"`{each.key}`"))
    tables = [markdown_table(("stage", "", "time", "artifact"), rows, right=[2])]
    if numbers:
        shown = [(name, significant(value, 4)) for name, value in numbers.items()]
        tables.append(markdown_table(("number", ""), shown, right=[1]))
    return "\n".join([f"**{title}**", "", *tables]).rstrip("\n")
