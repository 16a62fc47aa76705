"""What to measure, and how much of it."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from fleet.record.report_file import Record


class SectionName(StrEnum):
    """The parts of a bench, in the order in which they are measured."""

    PREDICTION = "prediction"
    COMPARISON = "comparison"
    DECISION = "decision"
    BUS = "bus"
    RUNS = "runs"
    STARTUP = "startup"
    COMPILING = "compiling"


MOST_ROBOTS = 32
"""More do not find room on the border of the area of ±10 m."""

Count = Annotated[int, Field(ge=1)]


class Settings(Record):
    """What a bench is told; part of its report, so that it can be repeated."""

    sections: tuple[SectionName, ...] = tuple(SectionName)
    robots: tuple[Annotated[int, Field(ge=2, le=MOST_ROBOTS)], ...] = (2, 4, 8, 16, 32)
    seed: Annotated[int, Field(ge=0)] = 0
    """Of the first random crossing; the others follow."""
    crossings: Count = 40
    """Random crossings of up to eight robots."""
    steps: Annotated[int, Field(ge=2)] = 100
    """Of each closed loop of the joint prediction."""
    decisions: Count = 1600
    """A closed loop of whole decisions ends after so many, if its robots have not arrived before."""
    rounds: Count = 200
    """Over the bus, for each number of robots."""
    starts: Count = 3
    """Of an agent's process alone."""
    reference: bool = True
    """Whether the reference solver is measured too."""

    def crossings_of(self, robots: int) -> int:
        """Fewer where there are more robots, whose loops take long."""
        return max(1, round(self.crossings * min(1.0, (8.0 / robots) ** 2)))
