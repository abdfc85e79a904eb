"""Floating-point operations of one SAC update, from the sizes of its networks.

A layer of n inputs and m outputs on a batch of B costs 2 B n m operations forward, as many for the gradient of its
weights and as many for the gradient of its inputs. Bias, activation, loss and optimiser are left out: they are not
products. Two counts of an update (Haarnoja et al. 2018), with H the policy and Q one critic:

textbook  critics: H forward on s', 2 Q' forward, 2 Q forward, 2 Q weights, 2 Q inputs from the second layer on
          policy:  H forward, 2 Q forward, 2 Q inputs of all layers (all n + a columns), H weights, H inputs from the
                   second layer on
useful    the same, but the policy needs the critics' input gradient only in the a columns of the action
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise


@dataclass(frozen=True)
class Product:
    """(rows, inner) times (inner, columns), `count` times per update; a delayed policy has fractions of a count."""

    rows: int
    inner: int
    columns: int
    count: float = 1.0

    @property
    def flops(self) -> float:
        """Multiplications and additions of all of them."""
        return 2.0 * self.rows * self.inner * self.columns * self.count


def total(products: Sequence[Product]) -> float:
    """Operations per update."""
    return sum(product.flops for product in products)


def forward(sizes: Sequence[int], batch: int, count: float) -> list[Product]:
    """Outputs of all layers."""
    return [Product(batch, inputs, outputs, count) for inputs, outputs in pairwise(sizes)]


def weight_gradients(sizes: Sequence[int], batch: int, count: float) -> list[Product]:
    """Gradients of all weights."""
    return [Product(inputs, batch, outputs, count) for inputs, outputs in pairwise(sizes)]


def input_gradients(sizes: Sequence[int], batch: int, count: float, first: int = 0) -> list[Product]:
    """Gradients of the inputs of all layers; of the first layer only `first` columns (0: none)."""
    columns = [first, *sizes[1:-1]]
    return [
        Product(batch, outputs, inputs, count) for inputs, outputs in zip(columns, sizes[1:], strict=True) if inputs > 0
    ]


def update(
    *, observation: int, action: int, hidden: Sequence[int], batch: int, policy_delay: int, critic_columns: int
) -> list[Product]:
    """Products of an update whose policy step takes the critics' gradient in `critic_columns` input columns."""
    policy = [observation, *hidden, 2 * action]
    critic = [observation + action, *hidden, 1]
    share = 1 / policy_delay
    return [
        *forward(policy, batch, 1),
        *forward(critic, batch, 2),
        *forward(critic, batch, 2),
        *weight_gradients(critic, batch, 2),
        *input_gradients(critic, batch, 2),
        *forward(policy, batch, share),
        *forward(critic, batch, 2 * share),
        *input_gradients(critic, batch, 2 * share, first=critic_columns),
        *weight_gradients(policy, batch, share),
        *input_gradients(policy, batch, share),
    ]


def textbook(*, observation: int, action: int, hidden: Sequence[int], batch: int, policy_delay: int) -> list[Product]:
    """What automatic differentiation of the losses as printed computes."""
    return update(
        observation=observation,
        action=action,
        hidden=hidden,
        batch=batch,
        policy_delay=policy_delay,
        critic_columns=observation + action,
    )


def useful(*, observation: int, action: int, hidden: Sequence[int], batch: int, policy_delay: int) -> list[Product]:
    """What the update needs."""
    return update(
        observation=observation,
        action=action,
        hidden=hidden,
        batch=batch,
        policy_delay=policy_delay,
        critic_columns=action,
    )
