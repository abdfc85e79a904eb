"""Two lanes of work that release the interpreter: the calling thread, and an executor of one thread beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

import torch

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


@contextmanager
def second_lane(wanted: bool) -> Iterator[Executor | None]:
    """The second lane while the block runs; None where it is not wanted."""
    if not wanted:
        yield None
        return
    # Flushing denormals is a setting of a thread; both lanes must round alike.
    with ThreadPoolExecutor(1, "lane", initializer=torch.set_flush_denormal, initargs=(True,)) as lane:
        yield lane


def submit_or_run(
    lane: Executor | None, work: Callable[Arguments, Result], *arguments: Arguments.args, **named: Arguments.kwargs
) -> Callable[[], Result]:
    """Begin `work` in the lane, in the order of the calls, or do it now where there is none; call for the result.

    What the lane has not come to when its result is asked for is done by the caller, instead of waiting for it.
    """
    if lane is None:
        result = work(*arguments, **named)
        return lambda: result
    future = lane.submit(work, *arguments, **named)
    return lambda: work(*arguments, **named) if future.cancel() else future.result()
