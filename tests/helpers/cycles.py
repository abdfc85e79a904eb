"""A finished teacher by CMA-ES that was never searched for: the first controller of its gait."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from romgrl.artifacts import Manifest, write_manifest
from romgrl.config.schema import Config
from romgrl.gait.metrics import GRAVITY
from romgrl.provenance.stage_keys import stage_settings
from romgrl.rom.gait_clocks import CLOCKS
from romgrl.rom.phase_policy import PhasePolicy, Span
from romgrl.stages.wiring.rom import rom_parameters
from romgrl.stages.wiring.teacher_policy import save_phase_policy


def write_cycles(directory: Path, config: Config, move: float = 0.0, gaits: str = "", **settings: Any) -> Manifest:
    """Write its artifact.

    move: of all its parameters; gaits: gait.csv, where there is one; settings: dotted keys of the manifest with __ for
    each dot.
    """
    directory.mkdir(parents=True)
    gait, speeds = config.teacher.gait, config.teacher.speeds
    unit = np.sqrt(GRAVITY * rom_parameters(config).leg_length)
    spans = [] if speeds is None else [Span("target_speed", speeds[0] / unit, speeds[1] / unit)]
    mean = CLOCKS[gait].mean + move
    policy = PhasePolicy(np.concatenate([mean, *(np.zeros(len(mean)) for _ in spans)]), gait, spans)
    save_phase_policy(directory / "policy.safetensors", policy)
    if gaits:
        (directory / "gait.csv").write_text(gaits, encoding="utf-8")
    made = json.loads(json.dumps(stage_settings("teacher", config)))
    made |= {name.replace("__", "."): value for name, value in settings.items()}
    facts = {"inputs": {}, "versions": {}, "revision": None, "dirty": None, "seed": 0, "wall_time": 1.0}
    return write_manifest(directory, stage="teacher", key="0123456789abcdef", config=made, **facts)
