"""The link between the world and one robot, with the faults of a run on it: payloads in, payloads out."""

from collections import deque
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from fleet.inject.command_faults import CommandDeliveryFault, InputFault
from fleet.inject.fault import MAX_LATE_STEPS, F, Fault, Scheduled, Strike, of_kind
from fleet.inject.observation_faults import AgeFault, DeliveryFault, PayloadFault, SightFault
from protocol.codec import MessageError, decode, encode
from protocol.messages import Command, Observation
from protocol.scene import MAX_ROBOTS, Scene
from protocol.vehicle import Input

LINK_FAULTS: Final = (AgeFault, SightFault, PayloadFault, DeliveryFault, InputFault, CommandDeliveryFault)
"""Kinds that lie on links; a robot that none of them befalls needs none."""


class Delivery(NamedTuple):
    """What reaches a robot at a step."""

    payloads: tuple[bytes, ...]
    """In this order."""
    answerable: bool
    """Whether the step's own observation is among them, intact; if not, no command of it is to be awaited."""


NOTHING: Final = Delivery((), answerable=False)


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
        self._scene = scene
        self._faults = [each.anew() for each in of_kind(faults, LINK_FAULTS, robot)]
        late = len(of_kind(self._faults, AgeFault))
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
        ways = [fault for fault, _ in self._striking(DeliveryFault, step)]
        copies = [fault.copies for fault in ways]
        if 0 in copies:
            return NOTHING
        for tampering, strike in self._striking(PayloadFault, step):
            return Delivery((tampering.payload(seen, strike),), answerable=False)
        payload, earlier = encode(seen), self._held_back
        if earlier is None and any(fault.held_back for fault in ways):
            self._held_back = payload
            return NOTHING
        self._held_back = None
        after = () if earlier is None else (earlier,)
        return Delivery((payload,) * max(copies, default=1) + after, answerable=True)

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
        changed = encode(self._driven(command))
        ways = [fault for fault, _ in self._striking(CommandDeliveryFault, command.step)]
        copies, late_steps = [fault.copies for fault in ways], sum(fault.late_steps() for fault in ways)
        if late_steps and 0 not in copies:
            self._late_commands.append((command.step + late_steps, changed))
        if late_steps or 0 in copies:
            return (encode(Command.withheld_at(command.epoch, command.robot, command.step)),)
        return (changed,) * max(copies, default=1)

    def due(self, step: int) -> tuple[bytes, ...]:
        """Commands that were delayed and reach the world at a step, before those of the step itself."""
        come = tuple(payload for when, payload in self._late_commands if when <= step)
        self._late_commands = [each for each in self._late_commands if each[0] > step]
        return come

    def _seen(self, observation: Observation) -> Observation:
        """The observation with an older view of the others and with other states."""
        step = observation.step
        late_steps = sum(fault.late_steps(strike) for fault, strike in self._striking(AgeFault, step))
        seen = _aged(observation, self._at(step - late_steps), self._robot) if late_steps else observation
        for fault, strike in self._striking(SightFault, step):
            robots = {**seen.robots, **fault.states(seen, strike, self._scene)}
            if len(robots) <= MAX_ROBOTS:  # no observation holds more
                seen = seen.model_copy(update={"robots": robots})
        return seen

    def _driven(self, command: Command) -> Command:
        """The command with other inputs for its step and for the step after."""
        limits = self._scene.robot(self._robot).limits
        for fault, _ in self._striking(InputFault, command.step):
            turn_rate, acceleration = fault.driven(command.input, limits)
            then = command.then and tuple(fault.driven(Input(*command.then), limits))
            changes = {"turn_rate_radps": turn_rate, "acceleration_mps2": acceleration, "then": then}
            command = command.model_copy(update=changes)
        return command

    def _at(self, step: int) -> Observation:
        """The observation of a past step; until there is one so old, the first one stands."""
        return next((each for each in reversed(self._past) if each.step <= step), self._past[0])

    def _striking(self, group: type[F], step: int) -> Iterator[tuple[F, Strike]]:
        """The faults of a group that strike at a step."""
        for each in of_kind(self._faults, group):
            strike = each.strike(self._robot, step)
            if strike is not None:
                yield each.fault, strike


def _aged(now: Observation, then: Observation, robot: str) -> Observation:
    """What an observer sees whose view of the others is of an earlier step, and says so."""
    own = {robot: now.robots[robot]} if robot in now.robots else {}
    others = {name: state for name, state in then.robots.items() if name != robot}
    age_steps = now.step - then.step + then.age_steps
    return now.model_copy(update={"robots": {**others, **own}, "age_steps": age_steps})
