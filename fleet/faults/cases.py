"""A suite of faults: cases, each with what has to hold beside it."""

from collections import Counter
from pathlib import Path
from typing import Annotated, Self

from pydantic import BeforeValidator, Field, StringConstraints, model_validator

from chassis.files import Record, read_as
from fleet.inject.scenario import Faults
from protocol.scenario import as_tuple

BUNDLED = Path(__file__).with_name("suite.yaml")

CaseName = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9-]{0,39}$")]


class Case(Record):
    """Faults, and what has to hold beyond what holds in every case (``fleet.faults.invariants``)."""

    name: CaseName
    faults: Annotated[Faults, Field(min_length=1)]
    everybody_arrives: bool = False
    """Also the robots that the faults befall."""
    no_collision: bool = False
    """None at all, instead of none that a healthy robot could have avoided."""
    settles_s: Annotated[float, Field(gt=0, le=1e3)] | None = None
    """So long after the end of the faults nobody is degraded any more."""

    @property
    def needs_processes(self) -> bool:
        """Whether it means nothing in virtual time."""
        return any(fault.needs_processes for fault in self.faults)


class Suite(Record):
    """What a file of cases says."""

    cases: Annotated[tuple[Case, ...], BeforeValidator(as_tuple), Field(min_length=1, max_length=1000)]

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        twice = [name for name, count in Counter(case.name for case in self.cases).items() if count > 1]
        if twice:
            raise ValueError(f"the name {twice[0]!r} is used twice; names of cases must differ")
        return self


def load_cases(path: Path) -> tuple[Case, ...]:
    """Read a suite of faults.

    Raises:
        Refusal: the file cannot be read or is no such suite; with file, line and field.
    """
    return read_as(path, Suite, "suite of faults").cases
