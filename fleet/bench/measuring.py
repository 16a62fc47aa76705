"""What all sections of a bench share: settings, progress, durations, and rows of a report and a table."""

import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import StrEnum
from typing import Annotated, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import Field
from rich.table import Table

from chassis.files import Record
from fleet.interruption import Interruption
from fleet.record.report import new_table, number

MOST_ROBOTS = 32
"""More find no room on the border of the area of ±10 m."""

Count = Annotated[int, Field(ge=1)]


class SectionName(StrEnum):
    """The sections of a bench, in the order in which they are measured."""

    PREDICTION = "prediction"
    COMPARISON = "comparison"
    DECISION = "decision"
    BUS = "bus"
    RUNS = "runs"
    STARTUP = "startup"
    COMPILING = "compiling"


class Settings(Record):
    """What is measured and how often; part of the report, so that a bench can be repeated."""

    sections: tuple[SectionName, ...] = tuple(SectionName)
    robots: tuple[Annotated[int, Field(ge=2, le=MOST_ROBOTS)], ...] = (2, 4, 8, 16, 32)
    seed: Annotated[int, Field(ge=0)] = 0
    """Of the first random crossing; the others take the numbers after it."""
    crossings: Count = 40
    """Random crossings of up to eight robots."""
    steps: Annotated[int, Field(ge=2)] = 100
    """Of each closed loop of the joint prediction."""
    decisions: Count = 1600
    """After so many, a closed loop of whole decisions ends whose robots have not arrived before."""
    rounds: Count = 200
    """Over the bus, for each number of robots."""
    starts: Count = 3
    """Of a single agent's process."""
    reference: bool = True
    """Whether the reference solver is measured too."""

    def crossings_of(self, robots: int) -> int:
        """Fewer where there are more robots, whose loops take long."""
        return max(1, round(self.crossings * min(1.0, (8.0 / robots) ** 2)))


class Progress:
    """Shows what the bench is doing, and ends it between two pieces of work.

    Args:
        interruption: the wish to end.
        show: shows a line to the person who waits.
    """

    def __init__(self, interruption: Interruption, show: Callable[[str], None]) -> None:
        self.interruption = interruption
        self._show = show

    def begin(self, work: str) -> None:
        """Announce the next piece of work.

        Raises:
            KeyboardInterrupt: it shall not begin.
        """
        if self.interruption.requested:
            raise KeyboardInterrupt
        self._show(work)


class Duration(NamedTuple):
    """How long one piece of work took on this thread, in ms."""

    cpu_ms: float
    wall_ms: float


class Timer:
    """A stopwatch that runs from its making; its wall clock counts the work of other processes too."""

    def __init__(self) -> None:
        self._cpu_s, self._wall_s = time.thread_time(), time.perf_counter()

    def read(self) -> Duration:
        """The time since it was made."""
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
    """A piece of work that was done ``count`` times."""

    count: int
    cpu: Distribution
    wall: Distribution

    @classmethod
    def of(cls, durations: Iterable[Duration]) -> Self:
        """Of at least one duration."""
        cpu_ms, wall_ms = zip(*durations, strict=True)
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

    @abstractmethod
    def lines(self) -> Iterable[Iterable[Cell]]:
        """The row in the table, which is mostly one line."""


def table(rows: Sequence[Row]) -> Table:
    """The table of a section that has rows."""
    result = new_table(rows[0].title, *rows[0].headers.split("|"), names=rows[0].names)
    for row in rows:
        for line in row.lines():
            result.add_row(*(cell if isinstance(cell, str) else number(cell) for cell in line))
        if row.names > 1:
            result.add_section()
    return result
