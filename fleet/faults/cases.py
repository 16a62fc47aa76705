"""Cases of faults, and what has to hold in each: before its faults, while they last, and after them."""

import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Self

from pydantic import BeforeValidator, Field, StringConstraints, model_validator

from chassis.files import Record, read_as
from fleet.faults.attribution import avoidable_collisions
from fleet.inject.fault import schedule
from fleet.inject.scenario import Faults, Scenario
from protocol.messages import Degradation, Message, Mind, Truth
from protocol.scenario import as_tuple

BUNDLED = Path(__file__).with_name("suite.yaml")
BEFORE_ALLOWED = frozenset({"intervention"})
"""The reserve may hold a robot back; nothing else is amiss as long as nothing is broken."""

CaseName = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9-]{0,39}$")]


class Case(Record):
    """Faults, and what has to hold beyond what holds in every case: see :func:`violations`."""

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


@dataclass
class Epoch:
    """One world from its start to its end."""

    truths: list[Truth] = field(default_factory=list)
    degraded: dict[tuple[int, str], tuple[Degradation, ...]] = field(default_factory=dict)
    """By step and robot, of every decision."""
    interventions: dict[str, int] = field(default_factory=dict)


class Evidence:
    """Gathers a run from its messages, by epochs in their order."""

    def __init__(self, messages: Iterable[Message] = ()) -> None:
        self._epochs: defaultdict[int, Epoch] = defaultdict(Epoch)
        for message in messages:
            self.add(message)

    def add(self, message: Message) -> None:
        """Take a truth or a mind; others say nothing more."""
        if isinstance(message, Truth):
            self._epochs[message.epoch].truths.append(message)
        elif isinstance(message, Mind):
            epoch = self._epochs[message.epoch]
            epoch.degraded[message.step, message.robot] = message.degraded
            epoch.interventions[message.robot] = message.interventions

    @property
    def epochs(self) -> list[Epoch]:
        """In their order."""
        return list(self._epochs.values())

    @property
    def end(self) -> Truth | None:
        """The last truth."""
        return next(reversed(self.epochs[-1].truths), None) if self.epochs else None


def violations(case: Case, scenario: Scenario, seed: int, evidence: Evidence) -> list[str]:
    """Everything that does not hold in a run, told for people; nothing if all is well."""
    if evidence.end is None:
        return ["nothing was recorded"]
    faults = schedule(case.faults, seed=seed, step_s=scenario.step_s)
    robots = {robot.id for robot in scenario.robots}
    healthy = {robot for robot in robots if not any(each.befalls(robot) for each in case.faults)}
    begin = min(each.begin for each in faults)
    ends = [each.end for each in faults if each.end is not None]
    found = lost_steps(evidence)
    if evidence.end.verdict is None:
        found.append("the run has no verdict")
    found += _amiss_before(evidence.epochs[0], begin)
    found += _collisions(case, scenario, evidence, healthy)
    driven = [truth.robots for truth in evidence.epochs[-1].truths]
    arrived = {name for each in driven for name, robot in each.items() if robot.arrived_s is not None}
    if missing := sorted((robots if case.everybody_arrives else healthy) - arrived):
        found.append(f"robot {', '.join(missing)} did not arrive")
    if case.settles_s is not None and len(ends) == len(faults):
        found += _unsettled(evidence.epochs[-1], max(ends), case.settles_s, scenario.step_s)
    return found


def lost_steps(evidence: Evidence) -> list[str]:
    """Whether the record lacks steps between the first and the last of an epoch."""
    for epoch in evidence.epochs:
        steps = list(dict.fromkeys(truth.step for truth in epoch.truths))  # an interrupted one comes twice
        if steps != list(range(len(steps))):
            return [f"the record lacks steps: {len(steps)} of {steps[-1] + 1} are there"]
    return [] if evidence.end is not None else ["nothing was recorded"]


def _amiss_before(epoch: Epoch, begin: int) -> Iterator[str]:
    before = [truth for truth in epoch.truths if truth.step < begin]
    if before and before[-1].collisions:
        yield "robots collided before the fault"
    for _, robot, degraded in _first_amiss(epoch, range(begin)):
        yield f"robot {robot} was degraded before the fault: {degraded}"


def _collisions(case: Case, scenario: Scenario, evidence: Evidence, healthy: set[str]) -> Iterator[str]:
    scene = scenario.scene(with_goals=False)
    for epoch in evidence.epochs:
        collisions = epoch.truths[-1].collisions if epoch.truths else ()
        if case.no_collision and collisions:
            yield f"robots {' and '.join(collisions[0])} collided"
            return
        for found in avoidable_collisions(epoch.truths, scene, healthy):
            yield (
                f"robot {found.robot} collided with robot {found.other} at step {found.step}; "
                f"braking at step {found.last_chance} would have avoided it"
            )


def _unsettled(epoch: Epoch, end: int, settles_s: float, step_s: float) -> Iterator[str]:
    settled = end + round(settles_s / step_s)
    for step, robot, degraded in _first_amiss(epoch, range(settled + 1, sys.maxsize)):
        yield f"robot {robot} was degraded {(step - end) * step_s:.1f} s after the fault: {degraded}"


def _first_amiss(epoch: Epoch, steps: range) -> Iterator[tuple[int, str, str]]:
    """At which of these steps a robot was degraded for the first time, which one and how; nothing if none."""
    for (step, robot), degraded in epoch.degraded.items():
        if step in steps and not BEFORE_ALLOWED.issuperset(degraded):
            yield step, robot, ", ".join(degraded)
            return
