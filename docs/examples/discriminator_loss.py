"""A loss of the discriminator of your own, the hinge: one record.

For `discriminator.loss=hinge` put it into LOSSES of romgrl/algorithms/adversarial_losses.py, and its name into LABELLED
of romgrl/config/learners.py.
"""

import torch
from torch import Tensor

from romgrl.algorithms.adversarial_losses import LOSSES, AdversarialLoss
from romgrl.algorithms.discriminator import Discriminator


def hinge(logits: Tensor, label_smoothing: float) -> Tensor:
    """E max(0, 1 - l) of what should be high (Lim and Ye 2017); there are no labels to smooth."""
    return (1 - logits).relu().mean()


LOSSES["hinge"] = AdversarialLoss(
    real=hinge,
    fake=lambda logits, label_smoothing: hinge(-logits, label_smoothing),
    reward=lambda logits, level: (0.5 * (logits + 1)).clamp(0, 1),
)


def main() -> dict[str, float]:
    """Tell two Gaussians apart: the accuracy on the teacher's, and the mean reward of either."""
    torch.manual_seed(0)
    teacher, student = torch.randn(2000, 5), torch.randn(2000, 5) + 3.0
    discriminator = Discriminator(
        reference=teacher, hidden_sizes=[32, 32], dropout=0.0, learning_rate=1e-3, penalty_weight=0.1,
        label_smoothing=0.0, noise=0.0, reward_limit=None, held_out=0.1, patience=None, standardize=True, seed=0,
        loss="hinge",
    )  # fmt: skip
    for _ in range(300):
        metrics = discriminator.update(student[torch.randint(2000, (64,))])
    rewards = {name: float(discriminator.reward(x).mean()) for name, x in (("teacher", teacher), ("student", student))}
    return {"accuracy": float(metrics["discriminator_accuracy_teacher"]), **rewards}


if __name__ == "__main__":
    print(main())
