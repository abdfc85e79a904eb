"""The learner of a student that follows commands: as that of one speed, of commanded windows."""

from __future__ import annotations

from concurrent.futures import Executor

import torch

from romgrl.algorithms.commanded_windows import CellWindows, WindowColumns
from romgrl.algorithms.conditioned_discriminator import ConditionedDiscriminator
from romgrl.algorithms.conditioned_rom_grl import CommandedBuffer, ConditionedRomGrl
from romgrl.algorithms.relabelling import Relabelling
from romgrl.config.commanded import conditioned_keys
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError, ConfigurationError
from romgrl.gait.discriminator_windows import WindowLayout, reference_windows
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.provenance.taught_cells import too_far
from romgrl.stages.conditioned.cells import CommandCells
from romgrl.stages.conditioned.commanded_frames import commanded_mirror, speed_payment
from romgrl.stages.wiring.student_learner import (
    buffer_settings,
    build_agent,
    discriminator_settings,
    learner_settings,
)


def build_conditioned_learner(
    config: Config,
    env: PlanarHumanoidVectorEnv,
    layout: WindowLayout,
    cells: CommandCells,
    lane: Executor | None = None,
) -> ConditionedRomGrl:
    """Wire agent, discriminator and replay buffer from the configuration; `lane` is a second thread for the agent."""
    student = conditioned_keys(config.student)
    columns = WindowColumns(layout.size, len(cells.gaits))
    limits = torch.tensor(cells.ranges, dtype=torch.float32, device=config.device)
    discriminator = build_conditioned_discriminator(config, layout, cells)
    return ConditionedRomGrl(
        buffer=CommandedBuffer(
            columns=columns,
            slowest=limits[:, 0].clone(),
            stratify=student.stratify,
            mirror_windows=commanded_mirror(layout, columns.size) if student.mirror else None,
            **buffer_settings(config, env),
        ),
        sac=build_agent(config, env, lane),
        discriminator=discriminator,
        relabelling=Relabelling(
            columns,
            limits,
            speed_payment(student.alpha),
            share=student.relabelled_share,
            weight=1.0 - student.posture_weight,
            seed=config.seed,
        ),
        cells=None if discriminator is None else discriminator.cells,
        **learner_settings(config, env),
    )


def build_conditioned_discriminator(
    config: Config, layout: WindowLayout, cells: CommandCells
) -> ConditionedDiscriminator | None:
    """The discriminator, with the windows of the taught cells; None for the baseline and where it has no weight.

    Raises ConfigurationError where mismatched windows cannot be had, which only the finished library tells.
    """
    seen, student = config.discriminator, conditioned_keys(config.student)
    if not seen.enabled or config.eta == 1:
        return None
    taught = cells.taught_cells
    if refused := too_far(student, [(cells.gaits[cells.gait[cell]], float(cells.speed[cell])) for cell in taught]):
        raise ConfigurationError(refused)
    windows = [
        reference_windows(
            cells.references[cell]["features"],
            cells.references[cell]["episode"],
            layout=layout,
            trunk_std=seen.trunk_std,
            trunk_time=seen.trunk_time,
            mirror=student.mirror,
            seed=config.seed + cell,
        )
        for cell in taught
    ]
    try:
        return ConditionedDiscriminator(
            CellWindows(
                [torch.from_numpy(each) for each in windows],
                cells.gait[taught].tolist(),
                cells.speed[taught].tolist(),
                gaits=len(cells.gaits),
                held_out=seen.held_out,
                by_command=student.standardize_by_command,
                device=config.device,
            ),
            mismatched=student.mismatched_share,
            distance=student.mismatch_distance,
            standardize=seen.standardize,
            weights=torch.from_numpy(layout.weights(seen.sole_weight)),
            **discriminator_settings(config),
        )
    except ValueError as error:
        raise ArtifactError(f"library: {error}") from error
