"""Two lanes of work."""

import threading

import pytest

from romgrl.algorithms.second_thread import second_lane, submit_or_run


def test_work_runs_beside_the_caller_and_in_order() -> None:
    seen: list[int] = []
    with second_lane(True) as lane:
        results = [
            submit_or_run(lane, lambda i=i: (seen.append(i), threading.current_thread().name)[1]) for i in range(3)
        ]
        names = [result() for result in reversed(results)]
    assert sorted(seen) == [0, 1, 2]
    assert len(names) == 3


def test_what_the_lane_has_not_come_to_is_done_by_the_caller() -> None:
    gate = threading.Event()
    with second_lane(True) as lane:
        blocked = submit_or_run(lane, gate.wait, 30)
        name = submit_or_run(lane, lambda: threading.current_thread().name)()
        assert name == threading.current_thread().name
        gate.set()
        assert blocked()


def test_without_a_lane_work_is_done_at_once() -> None:
    with second_lane(False) as lane:
        assert lane is None
        seen: list[int] = []
        result = submit_or_run(lane, seen.append, 1)
        assert seen == [1]
        result()
        assert seen == [1]


def test_an_error_reaches_the_caller() -> None:
    def fail() -> None:
        raise ValueError("broken")

    with second_lane(True) as lane:
        result = submit_or_run(lane, fail)
        with pytest.raises(ValueError, match="broken"):
            result()
