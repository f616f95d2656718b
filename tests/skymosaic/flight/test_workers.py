import threading
from typing import Any

import pytest

from skymosaic.flight import workers as flight_workers
from skymosaic.flight.workers import Workers


def test_results_come_in_order_while_further_calls_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight_workers, "_cores", lambda: 2)
    started, fourth = [], threading.Event()

    def call(number: Any) -> Any:
        started.append(number)
        if number == 3:
            fourth.set()
        return number

    steps = []
    with Workers(progress=lambda *step: steps.append(step)) as workers:
        results = workers.run("stage", call, [(number,) for number in range(100)])
        assert next(results) == 0
        assert fourth.wait(timeout=60)  # while the first result is still in use
        assert [0, *results] == list(range(100))
    assert sorted(started) == list(range(100))
    assert steps[-1] == ("stage", 100, 100)


def test_calls_run_only_so_far_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight_workers, "_cores", lambda: 1)
    started: list[int] = []
    with Workers() as workers:
        results: Any = workers.run("stage", started.append, [(number,) for number in range(100)])
        next(results)
        results.close()
    assert len(started) <= flight_workers.CALLS_PER_WORKER


def test_an_error_of_a_call_is_raised_where_its_result_is_due() -> None:
    def divided(number: Any) -> Any:
        return 1 // number

    with Workers() as workers, pytest.raises(ZeroDivisionError):
        list(workers.run("stage", divided, [(1,), (0,), (1,)]))
