"""The command line of romgrl with recorded gaits in the place of what was trained and measured; the report is made."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from romgrl.artifacts import MANIFEST
from romgrl.config.schema import Config
from romgrl.provenance import stage_graph
from romgrl.runtime.stage_log import StageLog
from tests.browser.walkers import write_run
from tests.helpers.finished import STAGES

BLUR = 0.04  # m: noise of the features of a student with eta = 1


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Copy a stage of the recorded run, in which a student with more eta is further from its teacher."""
    folder = output.parents[2] / "recorded" / f"{config.eta:g}"
    if not folder.exists():
        write_run(folder, steps=config.evaluation.steps, blur=BLUR * config.eta)
    shutil.copytree(folder / output.parent.name, output, ignore=shutil.ignore_patterns(MANIFEST), dirs_exist_ok=True)
    (output / "eta.txt").write_text(f"{config.eta:g}\n", encoding="utf-8")  # so that no student is taken for another


def main() -> None:
    """The command line with these stages."""
    from romgrl.__main__ import main as romgrl

    for name in STAGES:
        stage = stage_graph.STAGES[name]
        stage_graph.STAGES[name] = replace(stage, function="tests.browser.recorded:run")
    romgrl()


if __name__ == "__main__":
    main()
