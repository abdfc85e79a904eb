"""The machine's own rate of float32 matrix products."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import torch

from benchmarks.flops import Product, total

SQUARE = Product(2048, 2048, 2048)


def side(products: Sequence[Product], seconds: float) -> Callable[[], float]:
    """A side for `interleave`: GFLOP/s of the products in turn, about `seconds` long, on memory that is there."""
    tensors = [
        (torch.randn(p.rows, p.inner), torch.randn(p.inner, p.columns), torch.empty(p.rows, p.columns))
        for p in products
        for _ in range(max(1, round(p.count)))
    ]
    work = total([Product(p.rows, p.inner, p.columns, max(1, round(p.count))) for p in products])

    def measure() -> float:
        start, rounds = time.perf_counter(), 0
        while (spent := time.perf_counter() - start) < seconds or not rounds:
            for left, right, out in tensors:
                torch.mm(left, right, out=out)
            rounds += 1
        return rounds * work / spent / 1e9

    return measure


def rates(threads: int) -> dict[str, float]:
    """GFLOP/s of a large square on one thread and on `threads`, by their number."""
    before, found = torch.get_num_threads(), {}
    for count in sorted({1, threads}):
        torch.set_num_threads(count)
        measure = side([SQUARE], seconds=0.5)
        measure()
        found[str(count)] = round(measure(), 1)
    torch.set_num_threads(before)
    return found
