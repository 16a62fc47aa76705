"""Durations as the bench gives them: distributions of thread CPU time and of wall-clock time, in ms."""

import time
from collections.abc import Iterable
from typing import NamedTuple, Self

import numpy as np

from fleet.record.report_file import Record


class Duration(NamedTuple):
    """How long one piece of work took on this thread, in ms."""

    cpu_ms: float
    wall_ms: float


class Timer:
    """Runs from its making; on a shared machine the wall clock also counts the work of others."""

    def __init__(self) -> None:
        self._cpu_s, self._wall_s = time.thread_time(), time.perf_counter()

    def read(self) -> Duration:
        """How long it has run."""
        return Duration(1e3 * (time.thread_time() - self._cpu_s), 1e3 * (time.perf_counter() - self._wall_s))


class Distribution(Record):
    """Percentiles as ``numpy.percentile`` gives them, in ms."""

    median_ms: float
    p90_ms: float
    p99_ms: float
    max_ms: float

    @classmethod
    def of(cls, values_ms: Iterable[float]) -> Self:
        """Of at least one value."""
        median, p90, p99, most = np.percentile(list(values_ms), [50.0, 90.0, 99.0, 100.0]).tolist()
        return cls(median_ms=median, p90_ms=p90, p99_ms=p99, max_ms=most)


class Times(Record):
    """A piece of work that was done a number of times."""

    count: int
    cpu: Distribution
    wall: Distribution

    @classmethod
    def of(cls, durations: Iterable[Duration]) -> Self:
        """Of at least one duration."""
        cpu_ms, wall_ms = zip(*durations, strict=True)
        return cls(count=len(cpu_ms), cpu=Distribution.of(cpu_ms), wall=Distribution.of(wall_ms))
