"""Another body: nine bodies of other names, without arms.

For `humanoid=walker humanoid.xml=docs/examples/walker.xml` put the record into romgrl/humanoid/skeleton.py and its
SKELETONS, its name into SKELETONS of romgrl/config/worlds.py, and presets/humanoid/walker.yaml into conf/humanoid.
"""

import tempfile
from pathlib import Path

from romgrl.cli.compose import compose_config
from romgrl.humanoid.skeleton import SKELETONS, Limbs, Skeleton
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import student

XML = Path(__file__).with_name("walker.xml")
WALKER = Skeleton(
    name="walker",
    parents={
        "thigh_left": "pelvis", "shin_left": "thigh_left", "foot_left": "shin_left",
        "thigh_right": "pelvis", "shin_right": "thigh_right", "foot_right": "shin_right",
        "trunk": "pelvis", "head": "trunk",
    },
    sides=("_left", "_right"),
    left=Limbs(hip="thigh_left", knee="shin_left", ankle="foot_left"),
    trunk=("trunk",),
    neck="head",
    head="head",
    pushed="trunk",
    welded=frozenset({"head"}),
)  # fmt: skip
SKELETONS[WALKER.name] = WALKER


def main(steps: int = 2000) -> Path:
    """Train a baseline, which runs by the task's reward alone, for a moment, and return its policy."""
    small = ("num_envs=8", "hidden_sizes=[32,32]", "updates_per_step=0.05", "learning_starts=500", "check_steps=1000")
    learner = [f"student.{setting}" for setting in (*small, f"total_steps={steps}")]
    config = compose_config("stage=baseline", "discriminator=none", "eta=1", "threads=1", *learner)
    config.humanoid.xml, config.humanoid.skeleton = str(XML), WALKER.name
    output = Path(tempfile.mkdtemp())
    student.run(config, {}, output, SilentLog())
    return output / "policy.safetensors"


if __name__ == "__main__":
    print(main())
