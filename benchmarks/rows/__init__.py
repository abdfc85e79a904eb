"""All rows, in the order of the table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.measure import Options, Result
from benchmarks.rows import checks, commands, humanoid, rom, sac, scaling, student, teacher


@dataclass(frozen=True)
class Row:
    """What a row says, and the function that measures it."""

    title: str
    measure: Callable[[Options], Result]


ROWS: dict[str, Row] = {
    "rom_env": Row("ROM env through Python beside a bare C++ loop, 1 thread", rom.overhead_one_thread),
    "rom_env_two_threads": Row("the same on 2 threads", rom.overhead_two_threads),
    "rom_threads": Row("ROM env on 2 threads beside 1", rom.two_threads),
    "rom_box2d": Row("ROM physics per core, Box2D", rom.box2d),
    "rom_native": Row("ROM physics per core, native engine", rom.native),
    "rom_native_motors": Row("the same of legs with motors", rom.native_motors),
    "teacher_vs_sb3": Row("teacher training beside Stable-Baselines3's PPO", teacher.beside_sb3),
    "teacher_vs_sample_factory": Row("teacher training beside Sample Factory's APPO", teacher.beside_sample_factory),
    "teacher_time_to_check": Row("default teacher until its gait passes, median of 3 seeds", checks.teacher),
    "humanoid_env": Row("humanoid env beside bare mj_step", humanoid.beside_physics),
    "humanoid_vs_gymnasium": Row("humanoid env per core beside one env in Python", humanoid.beside_one_env),
    "sac_vs_sb3": Row("SAC update, constant columns dropped, beside Stable-Baselines3's", sac.against_sb3),
    "sac_vs_sb3_all_columns": Row("SAC update, all columns, beside Stable-Baselines3's", sac.against_sb3_all_columns),
    "sac_vs_cleanrl": Row("SAC update, constant columns dropped, beside CleanRL's", sac.against_cleanrl),
    "sac_flops_same_shapes": Row("SAC update: useful FLOPs beside sgemm at the same shapes", sac.flops_same_shapes),
    "sac_flops_square": Row("SAC update: useful FLOPs beside sgemm at a large square", sac.flops_square),
    "student_overlap": Row("student stage beside the longer of physics and learner alone", student.overlap),
    "student_memory": Row("memory of the student stage, 1e6 transitions", student.memory),
    "student_cuda": Row("updates on a GPU beside the processor", student.cuda),
    "time_to_check": Row("default student until it passes its check, median of 3 seeds", checks.student),
    "help_time": Row("python -m romgrl --help", commands.help_time),
    "reused_run": Row("a run where every stage is reused", commands.reused_run),
    "tracking_share": Row("a training with MLflow beside one without", commands.tracking_share),
    "fresh_run": Row("fresh clone to report", commands.fresh_run),
    "scaling_rom": Row("ROM env against number of worlds", scaling.rom_worlds),
    "scaling_humanoids": Row("humanoid env against number of humanoids", scaling.humanoids),
    "scaling_updates": Row("SAC updates against batch and width", scaling.updates),
    "scaling_threads": Row("stage time against threads", scaling.threads),
}
