"""What all sections of a bench share: settings, progress, durations, and rows of a report and a table."""

import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator
from enum import StrEnum
from typing import Annotated, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import Field

from agent.solve.vehicle import Array
from chassis.files import Record
from fleet.interruption import Interruption

MOST_ROBOTS = 32
"""More find no room on the border of the area of ±10 m."""

SectionName = StrEnum(
    "SectionName", ["prediction", "comparison", "decision", "bus", "runs", "startup", "compiling"]
)
"""In the order in which they are measured."""


class Settings(Record):
    """What is measured and how often; part of the report, so that a bench can be repeated."""

    sections: tuple[SectionName, ...] = tuple(SectionName)
    robots: tuple[Annotated[int, Field(ge=2, le=MOST_ROBOTS)], ...] = (2, 4, 8, 16, 32)
    crossings: int = Field(
        40, ge=1, description="Random crossings per number of robots up to 8; fewer for more robots."
    )
    seed: int = Field(
        0, ge=0, description="Seed of the first random crossing; the others take the next ones."
    )
    steps: int = Field(100, ge=2, description="Steps per closed loop of the joint prediction.")
    decisions: int = Field(1600, ge=1, description="Maximum decisions per closed loop of whole decisions.")
    rounds: int = Field(200, ge=1, description="Round trips over the bus per number of robots.")
    starts: int = Field(3, ge=1, description="Number of start-ups of a single agent process to time.")
    reference: bool = Field(True, description="Compare with the reference solver, which takes minutes.")

    def crossings_of(self, robots: int) -> int:
        """Fewer where there are more robots, whose loops take long."""
        return max(1, round(self.crossings * min(1.0, (8.0 / robots) ** 2)))


class Progress(NamedTuple):
    """Shows what the bench is doing, and ends it between two pieces of work."""

    interruption: Interruption
    show: Callable[[str], object]
    """Shows a line to the person who waits."""

    def begin(self, work: str) -> None:
        """Announce the next piece of work.

        Raises:
            KeyboardInterrupt: it shall not begin.
        """
        if self.interruption.requested:
            raise KeyboardInterrupt
        self.show(work)


def clocks_ms() -> Array:
    """CPU time of this thread and wall-clock time, shape (2,), in ms from any fixed points.

    Two readings differ by how long the work between them took; its wall-clock time counts the work of other
    processes too.
    """
    return 1e3 * np.array([time.thread_time(), time.perf_counter()])


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
    """A piece of work that was done ``count`` times."""

    count: int
    cpu: Distribution
    wall: Distribution

    @classmethod
    def of(cls, durations_ms: Iterable[Array]) -> Self:
        """Of at least one difference of :func:`clocks_ms`."""
        cpu_ms, wall_ms = np.transpose(list(durations_ms))
        return cls(count=len(cpu_ms), cpu=Distribution.of(cpu_ms), wall=Distribution.of(wall_ms))


Cell = str | float | None
"""Numbers are shown with the digits that matter, None as a dash."""


class Row(Record):
    """A section, by one of its rows: how it is measured, and shown in the section's table."""

    title: ClassVar[str]
    """Of the table."""
    headers: ClassVar[str]
    """Of its columns, with ``|`` between them."""
    names: ClassVar[int] = 1
    """Columns of names, which stand to the left of those of numbers."""

    @classmethod
    @abstractmethod
    def measure(cls, settings: Settings, progress: Progress) -> Iterator[Self]:
        """Measure the section, row by row.

        Raises:
            KeyboardInterrupt: it is to end.
            Refusal: a process that it needs has failed.
        """

    def lines(self) -> Iterable[Iterable[Cell]]:
        """The row in the table: one line with all of its fields, if nothing else is said."""
        yield dict(self).values()
