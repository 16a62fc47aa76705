"""What has to hold in a trial: before its faults, while they last, and after them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from fleet.faults.attribution import avoidable_collisions
from fleet.faults.cases import Case
from fleet.inject.fault import schedule
from fleet.inject.scenario import Scenario
from protocol.messages import Degradation, Message, Mind, Truth


@dataclass
class Epoch:
    """One world from its start to its end."""

    truths: list[Truth] = field(default_factory=list)
    degraded: dict[tuple[int, str], tuple[Degradation, ...]] = field(default_factory=dict)
    """By step and robot, of every decision."""
    interventions: dict[str, int] = field(default_factory=dict)


class Evidence:
    """Gathers a run from its messages.

    Attributes:
        epochs: in their order.
    """

    def __init__(self, messages: Iterable[Message] = ()) -> None:
        self.epochs: list[Epoch] = []
        self._numbers: dict[int, Epoch] = {}
        for message in messages:
            self.add(message)

    def add(self, message: Message) -> None:
        """Take a truth or a mind; others say nothing more."""
        if isinstance(message, Truth):
            self._of(message.epoch).truths.append(message)
        elif isinstance(message, Mind):
            epoch = self._of(message.epoch)
            epoch.degraded[message.step, message.robot] = message.degraded
            epoch.interventions[message.robot] = message.interventions

    @property
    def end(self) -> Truth | None:
        """The last truth."""
        truths = self.epochs[-1].truths if self.epochs else []
        return truths[-1] if truths else None

    def _of(self, number: int) -> Epoch:
        if number not in self._numbers:
            self._numbers[number] = Epoch()
            self.epochs.append(self._numbers[number])
        return self._numbers[number]


BEFORE_ALLOWED = frozenset({"intervention"})
"""A collision monitor may err; nothing else is amiss as long as nothing is broken."""


def violations(case: Case, scenario: Scenario, seed: int, evidence: Evidence) -> list[str]:
    """Everything that does not hold, told for people; nothing if all is well.

    Args:
        case: what befell the run.
        scenario: what was driven.
        seed: of the run.
        evidence: what came of it.
    """
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
    arrived = {
        name
        for truth in evidence.epochs[-1].truths
        for name, robot in truth.robots.items()
        if robot.arrived_s is not None
    }
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
    for (step, robot), degraded in epoch.degraded.items():
        if step < begin and not BEFORE_ALLOWED.issuperset(degraded):
            yield f"robot {robot} was degraded before the fault: {', '.join(degraded)}"
            return


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
    for (step, robot), degraded in epoch.degraded.items():
        if step > settled and not BEFORE_ALLOWED.issuperset(degraded):
            late_s = (step - end) * step_s
            yield f"robot {robot} was degraded {late_s:.1f} s after the fault: {', '.join(degraded)}"
            return
