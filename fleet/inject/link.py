"""The link between the world and one robot, with the faults of a run on it: payloads in, payloads out."""

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

from fleet.inject.commanding import DRIVEN_OTHERWISE, driven_otherwise
from fleet.inject.observing import LATE_BY_STEPS, SEEN_OTHERWISE, aged
from fleet.inject.schedule import Scheduled
from fleet.inject.tampering import TAMPERING
from protocol.codec import MessageError, decode, encode
from protocol.faults import (
    MAX_LATE_STEPS,
    CommandDelay,
    CommandDuplication,
    CommandLoss,
    Duplication,
    Fault,
    Loss,
    Reordering,
    Slow,
)
from protocol.messages import Command, Observation
from protocol.scene import MAX_ROBOTS, Scene

UNDELIVERED: Final = (Loss, Slow)
"""By these a robot does not get to an observation at all."""

LINK_KINDS: Final[tuple[type[Any], ...]] = (
    *LATE_BY_STEPS,
    *SEEN_OTHERWISE,
    *TAMPERING,
    *UNDELIVERED,
    *DRIVEN_OTHERWISE,
    Duplication,
    Reordering,
    CommandLoss,
    CommandDelay,
    CommandDuplication,
)
"""The kinds of faults that lie on links."""


class Delivery(NamedTuple):
    """What reaches a robot at a step."""

    payloads: tuple[bytes, ...]
    """In this order."""
    answerable: bool
    """Whether the step's own observation is among them, intact; if not, no command of it is to be awaited."""


def link_faults(faults: Iterable[Scheduled[Fault]], robot: str) -> list[Scheduled[Fault]]:
    """Those that lie on the link of a robot; without any, it needs none."""
    return [each for each in faults if isinstance(each.fault, LINK_KINDS) and each.befalls(robot)]


class Link:
    """Hands on what the world and one robot say to each other, as the faults of a run let it.

    What is random follows from the seed of the run, the robot and the step; nothing here reads a clock. One
    link serves one epoch of the world.

    The view of the others becomes older first, then states change in the order of the faults in their list,
    and last comes what is done to the bytes on their way. An input changes in the order of the list, too.

    Args:
        faults: of the run; those that do not lie on this link change nothing.
        robot: at the other end.
        scene: of the run.
    """

    def __init__(self, faults: Sequence[Scheduled[Fault]], robot: str, scene: Scene) -> None:
        self._robot = robot
        self._limits = scene.robot(robot).limits
        self._faults = link_faults(faults, robot)
        self._seen_otherwise = [
            SEEN_OTHERWISE[type(each.fault)](each, robot, scene)
            for each in self._faults
            if type(each.fault) in SEEN_OTHERWISE
        ]
        late = sum(type(each.fault) in LATE_BY_STEPS for each in self._faults)
        self._past: deque[Observation] = deque(maxlen=late * MAX_LATE_STEPS + 1)
        self._held_back: bytes | None = None
        self._late_commands: list[tuple[int, bytes]] = []

    def observed(self, observation: Observation) -> Delivery:
        """The world shows the robot something.

        Args:
            observation: of a step after the last one.

        Returns:
            What reaches the robot at this step.
        """
        self._past.append(observation)
        step, seen = observation.step, self._seen(observation)
        if self._struck(step, UNDELIVERED):
            return Delivery((), answerable=False)
        if tampering := self._struck(step, TAMPERING):
            first = tampering[0]
            return Delivery((TAMPERING[type(first.fault)](first, self._robot, seen),), answerable=False)
        payload, earlier = encode(seen), self._held_back
        if earlier is None and self._struck(step, (Reordering,)):
            self._held_back = payload
            return Delivery((), answerable=False)
        self._held_back = None
        twice = (payload,) if self._struck(step, (Duplication,)) else ()
        after = () if earlier is None else (earlier,)
        return Delivery((payload, *twice, *after), answerable=True)

    def commanded(self, payload: bytes) -> tuple[bytes, ...]:
        """The robot gives a command.

        Returns:
            What reaches the world now. Where the command does not, that is one which says that it is
            withheld, so that it is not waited for.
        """
        try:
            command = decode(Command, payload)
        except MessageError:
            return (payload,)  # the world refuses and counts it
        step = command.step
        for fault in self._struck(step, DRIVEN_OTHERWISE):
            command = driven_otherwise(fault, command, self._limits)
        changed = encode(command)
        withheld = encode(Command.withheld_at(command.epoch, command.robot, step))
        if self._struck(step, (CommandLoss,)):
            return (withheld,)
        if late := self._struck(step, (CommandDelay,)):
            late_steps = sum(each.fault.steps for each in late)
            self._late_commands.append((step + late_steps, changed))
            return (withheld,)
        return (changed, changed) if self._struck(step, (CommandDuplication,)) else (changed,)

    def due(self, step: int) -> tuple[bytes, ...]:
        """Commands that were delayed and reach the world at a step, before those of the step itself."""
        come = tuple(payload for when, payload in self._late_commands if when <= step)
        self._late_commands = [each for each in self._late_commands if each[0] > step]
        return come

    def _seen(self, observation: Observation) -> Observation:
        """The observation with an older view of the others and with other states."""
        step = observation.step
        late_steps = sum(
            LATE_BY_STEPS[type(each.fault)](each, self._robot, step)
            for each in self._struck(step, LATE_BY_STEPS)
        )
        seen = aged(observation, self._at(step - late_steps), self._robot) if late_steps else observation
        for otherwise in self._seen_otherwise:
            if otherwise.scheduled.strikes(self._robot, step):
                robots = {**seen.robots, **otherwise.states(seen)}
                if len(robots) <= MAX_ROBOTS:  # no observation holds more
                    seen = seen.model_copy(update={"robots": robots})
        return seen

    def _at(self, step: int) -> Observation:
        """The observation of a past step; until there is one so old, the first one stands."""
        return next((each for each in reversed(self._past) if each.step <= step), self._past[0])

    def _struck(self, step: int, kinds: Iterable[type[Any]]) -> list[Scheduled[Any]]:
        """The faults of these kinds that strike at a step."""
        wanted = tuple(kinds)
        return [
            each
            for each in self._faults
            if isinstance(each.fault, wanted) and each.strikes(self._robot, step)
        ]
