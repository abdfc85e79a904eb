"""NaN, infinite and absurd numbers stop a training within one update, and nothing good is overwritten by them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from romgrl.algorithms.discriminator import Discriminator
from romgrl.algorithms.ppo import PPO
from romgrl.algorithms.sac import SAC
from romgrl.artifacts import load_tensors
from romgrl.artifacts.checkpoint import CHECKPOINT, Checkpoints, flatten_state
from romgrl.errors import DivergenceError
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.rom import _core
from romgrl.rom.vector_env import SpringLegVectorEnv
from tests.conftest import Composer
from tests.helpers.cut_trainings import Recorder, train, training

LEARNED = ("loss", "gradient", "weights")  # one spoils the others within an update of PPO
BAD = {"nan": float("nan"), "inf": float("inf"), "1e12": 1e12}
Injection = Callable[[pytest.MonkeyPatch, float, "Trigger"], None]


class Trigger:
    """True once, from the moment it is armed."""

    armed = fired = False

    def __call__(self) -> bool:
        now, self.armed = self.armed, False
        self.fired |= now
        return now


def wrap(patch: pytest.MonkeyPatch, owner: type, name: str, after: Callable[..., Any]) -> None:
    """Let `after(self, result)` see and change what a method returns."""
    original = getattr(owner, name)

    def replacement(self: Any, *arguments: Any, **named: Any) -> Any:
        return after(self, original(self, *arguments, **named))

    patch.setattr(owner, name, replacement)


def spoil_step(column: int, env: type) -> Injection:
    """A number among the observations (0) or rewards (1) of a step."""

    def inject(patch: pytest.MonkeyPatch, value: float, now: Trigger) -> None:
        def after(_: Any, step: tuple[Any, ...]) -> tuple[Any, ...]:
            if now():
                step[column].reshape(-1)[0] = value
                step[4]["final_obs"].reshape(-1)[0] = step[0].reshape(-1)[0]
            return step

        wrap(patch, env, "step", after)

    return inject


def spoil_state(patch: pytest.MonkeyPatch, value: float, now: Trigger) -> None:
    """The speed of a joint of one humanoid, before the physics of a step."""
    original = PlanarHumanoidVectorEnv.step

    def step(env: PlanarHumanoidVectorEnv, actions: Any) -> Any:
        if now():
            env._qvel[0, 5] = value
        return original(env, actions)

    patch.setattr(PlanarHumanoidVectorEnv, "step", step)


def spoil_world(patch: pytest.MonkeyPatch, value: float, now: Trigger) -> None:
    """A pose that flies apart, before the physics of a step; the core takes no state with worse numbers."""
    original = SpringLegVectorEnv.step

    def step(env: SpringLegVectorEnv, actions: Any) -> Any:
        if now():
            pose = _core.Pose()
            pose.y, pose.vx, pose.vy, pose.leg_length, pose.hip_rate = 900.0, value, 999.0, [0.01, 0.4], [-99.0, 99.0]
            env._batch.place(0, pose)
        return original(env, actions)

    patch.setattr(SpringLegVectorEnv, "step", step)


def spoil_loss(owner: type, method: str, name: str) -> Injection:
    """A loss that an update returns."""

    def inject(patch: pytest.MonkeyPatch, value: float, now: Trigger) -> None:
        def after(_: Any, losses: dict[str, Any]) -> dict[str, Any]:
            bad = torch.tensor(value) if isinstance(losses[name], torch.Tensor) else value
            return losses | {name: bad} if now() else losses

        wrap(patch, owner, method, after)

    return inject


def spoil_gradient(owner: type, method: str, gradient: Callable[[Any], torch.Tensor]) -> Injection:
    """A number in a gradient, before the step along it."""

    def inject(patch: pytest.MonkeyPatch, value: float, now: Trigger) -> None:
        def after(learner: Any, result: Any) -> Any:
            if now():
                gradient(learner)[7] = value
            return result

        wrap(patch, owner, method, after)

    return inject


def spoil_weights(owner: type, flat: Callable[[Any], torch.Tensor]) -> Injection:
    """A weight, after an update has begun."""

    def inject(patch: pytest.MonkeyPatch, value: float, now: Trigger) -> None:
        original = owner.update

        def update(learner: Any, *arguments: Any, **named: Any) -> Any:
            optimizer = getattr(learner, "critic_optimizer", None) or learner.optimizer
            step = optimizer.step

            def spoiled() -> None:
                step()
                if now():
                    flat(learner)[7] = value

            patch.setattr(optimizer, "step", spoiled)
            try:
                return original(learner, *arguments, **named)
            finally:
                patch.setattr(optimizer, "step", step)

        patch.setattr(owner, "update", update)

    return inject


CASES: dict[str, dict[str, Injection]] = {
    "student": {
        "observation": spoil_step(0, PlanarHumanoidVectorEnv),
        "reward": spoil_step(1, PlanarHumanoidVectorEnv),
        "loss": spoil_loss(SAC, "critic_gradient", "critic_loss"),
        "gradient": spoil_gradient(SAC, "critic_gradient", lambda sac: sac.critic.gradient),
        "weights": spoil_weights(SAC, lambda sac: sac.critic.flat),
        "physics": spoil_state,
    },
    "teacher": {
        "observation": spoil_step(0, SpringLegVectorEnv),
        "reward": spoil_step(1, SpringLegVectorEnv),
        "loss": spoil_loss(PPO, "update", "value_loss"),
        "gradient": spoil_gradient(PPO, "policy_gradient", lambda ppo: ppo.gradient),
        "weights": spoil_weights(PPO, lambda ppo: ppo.weights),
        "physics": spoil_world,
    },
}


@pytest.mark.parametrize("name", CASES)
def test_bad_numbers_stop_a_training(
    name: str, compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = training(name, compose_config, "checkpoint_seconds=1e-9")
    caught = 0
    for quantity, inject in CASES[name].items():
        for label, value in ({"900": 900.0} if inject is spoil_world else BAD).items():
            output = tmp_path / f"{quantity}-{label}"
            with monkeypatch.context() as patch:
                recorder, trigger = Recorder(patch), Trigger()
                inject(patch, value, trigger)
                armed = arm_after(patch, recorder, trigger, passes=60 if name == "student" else 4)
                named = quantity if name == "student" or quantity not in LEARNED else "|".join(LEARNED)
                with pytest.raises(DivergenceError, match=rf"{name}: .*({named}).*, after step [\d,]+; the last"):
                    train(name, config, output)
            assert trigger.fired
            assert recorder.steps[-1] == armed[0], "the pass with the bad number was not stopped"
            assert_good(output, armed[0])
            caught += 1
    total = {"student": 18, "teacher": 16}[name]
    print(f"{name}: {caught} of {total} bad numbers stopped the training at once")
    assert caught == total


def arm_after(patch: pytest.MonkeyPatch, recorder: Recorder, trigger: Trigger, passes: int) -> list[int]:
    """Arm the trigger at the end of a pass of the loop; returns a list that will hold the step of that pass."""
    from romgrl.stages.training.checkpoints import TrainingCheckpoints

    keep, armed = TrainingCheckpoints.save_if_due, list[int]()

    def watched(checkpoints: TrainingCheckpoints, step: int) -> None:
        keep(checkpoints, step)
        if len(recorder.steps) == passes:
            trigger.armed = True
            armed.append(step)

    patch.setattr(TrainingCheckpoints, "save_if_due", watched)
    return armed


def assert_good(output: Path, step: int) -> None:
    """The checkpoint of the last good pass is there, and it and the policy are finite."""
    said: list[str] = []
    found = Checkpoints(output / CHECKPOINT, say=said.append).load()
    assert found is not None
    assert (found[0], said) == (step, [])
    numbers = [
        value for _, value in flatten_state(found[1]) if isinstance(value, torch.Tensor) and value.is_floating_point()
    ]
    numbers += load_tensors(output / "policy.safetensors")[0].values()
    assert all(np.isfinite(np.asarray(value, float)).all() for value in numbers)
    assert max(float(value.double().abs().max()) for value in numbers if value.numel()) < 1e10


def discriminator(learning_rate: float) -> Discriminator:
    return Discriminator(
        reference=torch.randn(64, 10),
        hidden_sizes=[8],
        dropout=0.0,
        learning_rate=learning_rate,
        penalty_weight=0.0,
        label_smoothing=0.1,
        noise=0.0,
        reward_limit=None,
        held_out=0.1,
        patience=None,
        standardize=False,
        seed=0,
    )


def test_the_update_that_spoils_the_discriminator_is_its_last() -> None:
    with pytest.raises(DivergenceError, match="discriminator weights"):
        discriminator(learning_rate=1e12).update(torch.randn(32, 10))


@pytest.mark.parametrize("label", BAD)
@pytest.mark.parametrize("quantity", ["loss", "gradient", "weights"])
def test_bad_numbers_stop_the_discriminator(label: str, quantity: str) -> None:
    judge = discriminator(learning_rate=1e-3)
    judge.update(torch.randn(32, 10))
    weight = next(judge.network.parameters())
    if quantity == "loss":
        judge.mean[0] = BAD[label]
    elif quantity == "gradient":
        weight.register_hook(lambda gradient: gradient + BAD[label])
    else:
        weight.data[0, 0] = BAD[label]
    with pytest.raises(DivergenceError, match="discriminator"):
        judge.update(torch.randn(32, 10))
