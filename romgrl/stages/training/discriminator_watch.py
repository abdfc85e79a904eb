"""The health of the discriminator while a student learns: a line when something begins, and health.json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import torch

from romgrl.algorithms.adversarial_losses import LOSSES
from romgrl.algorithms.discriminator_health import LASTING_ROWS, WATCHED, Diagnosis, TrainingSetting, diagnose
from romgrl.artifacts.checkpoint import State
from romgrl.config.schema import Config
from romgrl.runtime.stage_log import StageLog

FILE = "health.json"
TOO_SHORT = "too short to tell"


def health_setting(config: Config) -> TrainingSetting:
    """What the numbers of a training are measured against."""
    discriminator, zero = config.discriminator, torch.zeros(1)
    adversarial = LOSSES[discriminator.loss]
    return TrainingSetting(
        speed=config.speed,
        eta=config.eta,
        reward_limit=discriminator.reward_limit,
        undecided_reward=float(adversarial.paid(zero, zero, discriminator.reward_limit)),
        undecided_loss=adversarial.undecided_loss(discriminator.label_smoothing),
    )


class HealthWatch:
    """Rows of the learning curve since the discriminator began to learn, and what was wrong at each.

    health.json: `verdict`, the names that hold at the end, "healthy" or TOO_SHORT; `now`, with evidence and advice;
    `history`, from which step to which each has held.
    """

    def __init__(self, config: Config, output: Path, log: StageLog) -> None:
        self._setting, self._path, self._log = health_setting(config), output / FILE, log
        self._rows: list[dict[str, float]] = []  # with the step
        self._names: list[list[str]] = []  # what held at each

    def add(self, values: Mapping[str, float], step: int, eta: float) -> None:
        """Take in a row, made with this weight of the task; rows without a discriminator are none."""
        if any(name not in values for name in WATCHED):
            return
        before = self._names[-1] if self._names else []
        self._rows.append({"step": float(step), "eta": eta} | {name: values[name] for name in WATCHED})
        now = self._diagnoses(len(self._rows))
        self._names.append([diagnosis.name for diagnosis in now])
        for diagnosis in now:
            if diagnosis.name not in before:
                self._log.message(
                    f"discriminator: {diagnosis.name} at step {step:,}: {diagnosis.evidence}; {diagnosis.advice}"
                )
        document = {
            "verdict": ", ".join(self._names[-1]) or ("healthy" if len(self._rows) >= LASTING_ROWS else TOO_SHORT),
            "now": [diagnosis._asdict() for diagnosis in now],
            "history": self._history(),
        }
        self._path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")

    def state(self) -> State:
        """Everything that `restore` needs."""
        return {"numbers": [number for row in self._rows for number in row.values()]}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        names = ("step", "eta", *WATCHED)
        numbers, width = state["numbers"], len(names)
        rows = [numbers[start : start + width] for start in range(0, len(numbers), width)]
        self._rows = [dict(zip(names, row, strict=True)) for row in rows]
        heads = [self._diagnoses(count + 1) for count in range(len(self._rows))]
        self._names = [[diagnosis.name for diagnosis in found] for found in heads]

    def _diagnoses(self, count: int) -> list[Diagnosis]:
        """What is wrong after so many rows."""
        rows = self._rows[:count]
        return diagnose(rows, replace(self._setting, eta=rows[-1]["eta"]))

    def _history(self) -> list[dict[str, str | int]]:
        spells: list[dict[str, str | int]] = []
        running: dict[str, dict[str, str | int]] = {}
        for row, names in zip(self._rows, self._names, strict=True):
            step = int(row["step"])
            begun: dict[str, dict[str, str | int]] = {
                name: {"name": name, "first_step": step} for name in names if name not in running
            }
            spells += begun.values()
            running = {name: running.get(name) or begun[name] for name in names}
            for spell in running.values():
                spell["last_step"] = step
        return spells
