"""Phases are timed with the clock that the caller brings."""

from itertools import count

import pytest

from agent.telemetry import Stopwatch


def test_phases_and_the_whole_are_timed_in_milliseconds():
    readings = iter([10.0, 10.5, 10.75, 11.0, 13.0, 20.0])
    watch = Stopwatch(lambda: next(readings))
    with watch.phase("estimate"):
        pass
    with watch.phase("plan"):
        pass
    timings = watch.timings()
    assert (timings.estimate, timings.plan, timings.decide) == (250.0, 2000.0, 10000.0)
    assert timings.predict == 0.0, "it did not run"


def test_a_phase_that_ends_in_an_error_is_timed_too():
    ticks = count()
    watch = Stopwatch(lambda: float(next(ticks)))
    with pytest.raises(RuntimeError), watch.phase("predict"):
        raise RuntimeError
    assert watch.timings().predict == 1000.0
