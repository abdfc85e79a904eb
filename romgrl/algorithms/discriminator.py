"""Adversarial discriminator of the gait (paper section 3.3): ROM windows are real, the student's are fake."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn

from romgrl.algorithms.adversarial_losses import (
    LOSSES,
    interpolate_penalty,
    zero_penalty,
)
from romgrl.algorithms.divergence import require_finite
from romgrl.algorithms.tensor_state import optimizer_state, put_all, restore_optimizer

NOISE_RATE, NOISE_RANGE = 0.01, (0.02, 3.0)
"""Relative change of the noise per update and unit of accuracy: it doubles within some 500 updates that tell every
window."""
LEAST_DEVIATION = 1e-3
"""Of a column of the reference: what hardly changes is not blown up."""
GAP_TOLERANCE = 0.02
"""A gap counts as wider than the narrowest one from this share of an undecided discriminator's loss on: ten times what
it wavers by on a reference that is not learned by heart."""


class Discriminator:
    """Discriminator of windows of gait features, (B, window_size) -> logit (B,).

    `reference` holds the windows of the teacher, (N, window_size); the last `held_out` share of it validates. `weights`
    (window_size,) multiplies the columns as the network sees them, None: not at all; noise is the same for all columns
    then, so that what has less weight counts less.
    `noise` is the standard deviation of the Gaussian noise on both streams while training, in feature units, or in
    deviations of the reference where it is standardised; with `accuracy` it follows so that this share of the windows
    is told apart (after Karras et al. 2020, who adapt augmentations so). `loss` is a key of LOSSES; `penalty_on` says
    where the gradient penalty is taken: "interpolates" of both streams, with norm 1 as its aim, or with aim 0 on the
    "reference" or on "both" streams. `early_stop`: see `_validate`.
    """

    def __init__(
        self,
        *,
        reference: Tensor,
        hidden_sizes: list[int],
        dropout: float,
        learning_rate: float,
        penalty_weight: float,
        label_smoothing: float,
        noise: float,
        reward_limit: float | None,
        held_out: float,
        patience: int | None,
        standardize: bool,
        seed: int,
        loss: str = "bce",
        penalty_on: str = "interpolates",
        accuracy: float | None = None,
        early_stop: str = "gap",
        weights: Tensor | None = None,
        device: str = "cpu",
    ) -> None:
        torch.manual_seed(seed)
        self.generator = torch.Generator(device=device).manual_seed(seed)
        split = max(1, round(len(reference) * (1 - held_out)))
        if split >= len(reference):
            raise ValueError(f"held_out {held_out} leaves no window of {len(reference)} to validate")
        self.real, self.validation = reference[:split].to(device), reference[split:].to(device)
        self.learned = self.real[: len(self.validation)]  # what held-out windows are compared with
        scale = reference.std(0).clamp(min=LEAST_DEVIATION) if standardize else torch.ones(reference.shape[1])
        self.mean = (reference.mean(0) if standardize else torch.zeros(reference.shape[1])).to(device)
        self.scale = (1 / scale if weights is None else weights / scale).to(device)
        layers: list[nn.Module] = []
        for inputs, outputs in zip([reference.shape[1], *hidden_sizes[:-1]], hidden_sizes, strict=True):
            layers += [nn.Linear(inputs, outputs), nn.LeakyReLU(0.2), nn.Dropout(dropout)]
        self.network = nn.Sequential(*layers, nn.Linear(hidden_sizes[-1], 1)).to(device)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=learning_rate, fused=True)
        self.penalty_weight, self.label_smoothing = penalty_weight, label_smoothing
        self.noise, self.accuracy = torch.tensor(float(noise), device=device), accuracy
        self.reward_limit, self.patience, self.early_stop = reward_limit, patience, early_stop
        self.adversarial, self.penalty_on = LOSSES[loss], penalty_on
        self.level = torch.zeros((), device=device)  # mean logit of the held-out windows
        self.best_validation = torch.tensor(float("inf"), device=device)
        self.stale_updates = torch.zeros((), dtype=torch.int64, device=device)
        self.stopped = False
        self.updates = 0

    def logits(self, windows: Tensor) -> Tensor:
        """Logit of being the teacher's, (B,)."""
        return self._logit(self.inputs(windows))

    def inputs(self, windows: Tensor) -> Tensor:
        """What the network sees of windows."""
        return (windows - self.mean) * self.scale

    @torch.no_grad()
    def reward(self, windows: Tensor) -> Tensor:
        """Imitation reward (B,) of clean windows, dropout off."""
        self.network.eval()
        return self.adversarial.paid(self.logits(windows), self.level, self.reward_limit)

    def update(self, windows: Tensor) -> dict[str, Tensor]:
        """One step on as many windows of the teacher as of the student, (B, window_size)."""
        self.network.train()
        real, fake = map(self._perturb, self._streams(windows))
        real_logits, fake_logits = self.logits(real), self.logits(fake)
        loss = self.adversarial.loss(real_logits, fake_logits, self.label_smoothing)
        penalty = self._penalty(real, fake)
        self.optimizer.zero_grad()
        torch.autograd.backward(loss + self.penalty_weight * penalty)
        gradient_norm = nn.utils.get_total_norm([p.grad for p in self.network.parameters() if p.grad is not None])
        require_finite(discriminator_loss=loss.detach(), discriminator_gradient=gradient_norm)
        self.optimizer.step()
        require_finite(discriminator_weights=nn.utils.get_total_norm([p.detach() for p in self.network.parameters()]))
        self.updates += 1
        threshold = self.adversarial.threshold(real_logits, fake_logits)
        told = 0.5 * ((real_logits > threshold).float().mean() + (fake_logits < threshold).float().mean())
        if self.accuracy is not None:
            self.noise.mul_(torch.exp(NOISE_RATE * (told - self.accuracy))).clamp_(*NOISE_RANGE)
        return {
            "discriminator_noise": self.noise.clone(),
            "discriminator_loss": loss.detach(),
            "discriminator_accuracy_teacher": (real_logits > threshold).float().mean(),
            "discriminator_accuracy_student": (fake_logits < threshold).float().mean(),
            "discriminator_gradient_norm": gradient_norm,
            "discriminator_validation_loss": self._validate(),
        }

    def _streams(self, windows: Tensor) -> tuple[Tensor, Tensor]:
        """Windows that are real and fake, of those of the student."""
        index = torch.randint(len(self.real), (len(windows),), generator=self.generator, device=windows.device)
        return self.real[index], windows

    @torch.no_grad()
    def measures(self, windows: Tensor) -> dict[str, float]:
        """How it tells the student's windows (B, window_size) from the teacher's, without noise or dropout."""
        self.network.eval()
        student, teacher, held_out = self.logits(windows), self.logits(self.real), self.logits(self.validation)
        return self._measured(student, teacher, held_out, feature_gap(windows, self.real))

    def _measured(self, student: Tensor, teacher: Tensor, held_out: Tensor, gap: Tensor) -> dict[str, float]:
        """What is logged of logits (B,) of clean windows, and of `feature_gap`, by name."""
        values = {
            "logit_teacher": teacher.mean(),
            "logit_student": student.mean(),
            "logit_spread": torch.cat((teacher, student)).std(),
            "fit_loss": self.adversarial.loss(teacher, student, self.label_smoothing),
            "held_out_loss": self.adversarial.loss(held_out, student, self.label_smoothing),
            "feature_gap": gap,
        }
        return {f"discriminator_{name}": float(value) for name, value in values.items()}

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs; dropout draws from torch's own generator."""
        return {
            "updates": self.updates,
            "stopped": self.stopped,
            "generator": self.generator.get_state(),
            "dropout": torch.get_rng_state(),
            "tensors": self._tensors(),
            "optimizer": optimizer_state(self.optimizer),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.updates, self.stopped = state["updates"], state["stopped"]
        self.generator.set_state(state["generator"])
        torch.set_rng_state(state["dropout"])
        put_all(self._tensors(), state["tensors"])
        restore_optimizer(self.optimizer, state.get("optimizer", {}))

    def _tensors(self) -> dict[str, Tensor]:
        own = {"best_validation": self.best_validation, "stale_updates": self.stale_updates, "noise": self.noise}
        own |= {"level": self.level} if self.adversarial.relative else {}
        return own | dict(self.network.state_dict())

    @torch.no_grad()
    def _validate(self) -> Tensor:
        """Loss of the held-out windows of the teacher, clean and without dropout; counts the updates without progress.

        What has to fall is that loss ("held_out", the paper's words), or what it is above the loss of as many of the
        windows that are learned from ("gap"). The first also rises where the policy gets better, or the weights of both
        streams change; only the second says that windows are learned by heart.
        """
        self.network.eval()
        held_out = self.logits(self.validation)
        self.level = held_out.mean()
        loss = self.adversarial.real(held_out, self.label_smoothing)
        watched, tolerance = loss, 0.0
        if self.early_stop == "gap" and self.patience is not None:
            watched = loss - self.adversarial.real(self.logits(self.learned), self.label_smoothing)
            tolerance = GAP_TOLERANCE * self.adversarial.undecided_loss(self.label_smoothing)
        self.stale_updates = torch.where(watched < self.best_validation + tolerance, 0, self.stale_updates + 1)
        self.best_validation = torch.minimum(self.best_validation, watched)
        if self.patience is not None:
            self.stopped = bool(self.stale_updates >= self.patience)
        return loss

    def _logit(self, inputs: Tensor) -> Tensor:
        logit: Tensor = self.network(inputs).squeeze(-1)
        return logit

    def _penalty(self, real: Tensor, fake: Tensor) -> Tensor:
        """Slopes are by what the network sees: with standardised features, by their standard deviations."""
        real, fake = self.inputs(real), self.inputs(fake)
        if self.penalty_on == "interpolates":
            mix = torch.rand((len(real), 1), generator=self.generator, device=real.device)
            return interpolate_penalty(self._logit, real, fake, mix)
        return zero_penalty(self._logit, real if self.penalty_on == "reference" else torch.cat((real, fake)))

    def _perturb(self, windows: Tensor) -> Tensor:
        """Windows with noise, in the unit that the network sees."""
        noise = torch.randn(windows.shape, generator=self.generator, device=windows.device)
        return windows + self.noise * noise / self.scale


def feature_gap(student: Tensor, teacher: Tensor) -> Tensor:
    """How far windows (B, W) are from the teacher's (N, W), which does not ask a network.

    Root mean square over the columns of the difference of means, in standard deviations of the teacher, and of the
    logarithm of the ratio of the deviations.
    """
    deviation = teacher.std(0).clamp(min=LEAST_DEVIATION)
    shift = (student.mean(0) - teacher.mean(0)) / deviation
    ratio = (student.std(0).clamp(min=LEAST_DEVIATION) / deviation).log()
    return torch.cat((shift, ratio)).square().mean().sqrt()
