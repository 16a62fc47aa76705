"""A robot's commands: how they follow from its plan, and what it has driven by them."""

from collections import deque

from agent.drive.reserve import Reserve
from agent.drive.safety import LastResort, Vigilance
from agent.remember.memory import Memory
from agent.solve.planning import Plan, Room
from agent.solve.vehicle import Array
from agent.telemetry import Thought
from protocol.messages import Command, Degradation, Observation
from protocol.scene import Scene
from protocol.vehicle import (
    STANDSTILL,
    Input,
    Limits,
    Reachable,
    braking_input,
    reachable_inputs,
    speed_after,
)

LONGEST_BRAKING_STEPS = 1000
"""After so many steps without a command a robot is taken to stand."""
SAME = 1e-6
"""Relative to the limit, inputs that differ by no more are the same."""
DOUBTFUL = 3
"""So many of the last commands may have come too late without anything that showed it."""


class Driver:
    """Drives one robot by its plans, as far as the reserve allows, and brakes where it must not follow them.

    Args:
        scene: what everybody may know.
        robot: this robot's id.
        keeps_reserve: whether it keeps the reserve and brakes for those that do not; False for experiments.

    Attributes:
        history: its last commands.
        interventions: how often the reserve or the last resort has begun to hold it back.
    """

    def __init__(self, scene: Scene, robot: str, *, keeps_reserve: bool = True) -> None:
        self._robot = robot
        self._limits = scene.robot(robot).limits
        self._step_s = scene.step_s
        self._vigilance = Vigilance(scene, robot)
        self._keeps_reserve = keeps_reserve
        self._reserve = Reserve(scene, robot)
        self._last_resort = LastResort(scene, robot)
        self._is_held_back = False
        self.interventions = 0
        self.history = CommandHistory(robot, self._limits, scene.step_s)

    def look(self, observation: Observation, memory: Memory, previous: Input) -> Room:
        """Draw the lines of this step; what comes back tells a planner which inputs they leave it."""
        if not self._keeps_reserve:
            return lambda wanted: None
        self._reserve.update(memory, previous, observation.accuracy)
        speed_mps = float(memory.state(self._robot)[3])

        def room(wanted: Array) -> Reachable | None:
            driven = within_reach(wanted, self._limits, previous, speed_mps, self._step_s)
            return self._reserve.room(memory, driven, previous)

        return room

    def act(self, observation: Observation, memory: Memory, previous: Input, thought: Thought) -> Command:
        """The command that answers an observation, after the previous input and by what was thought of it.

        Where the plan is not to be followed, the thought is told why.
        """
        is_blind = self._vigilance.look(memory, observation.age_steps)
        speed_mps = float(memory.state(self._robot)[3])
        driven, thought.emergency = self._input(memory, previous, speed_mps, thought, is_blind)
        is_held_back = thought.emergency == "intervention"
        self.interventions += is_held_back and not self._is_held_back
        self._is_held_back = is_held_back
        command = Command(
            epoch=observation.epoch,
            robot=self._robot,
            step=observation.step,
            turn_rate_radps=driven.turn_rate_radps,
            acceleration_mps2=driven.acceleration_mps2,
        )
        self.history.add(command, speed_mps)
        return command

    def _input(
        self, memory: Memory, previous: Input, speed_mps: float, thought: Thought, is_blind: bool
    ) -> tuple[Input, Degradation | None]:
        """The input of this step, and why it is not the planned one."""
        limits, step_s, plan = self._limits, self._step_s, thought.plan
        braking = braking_input(limits, previous, speed_mps, step_s)
        if thought.arrived:
            return braking, None
        if is_blind:
            return braking, "controlled stop"
        failure: Degradation | None = None
        if plan is not None and plan.solved:
            wanted = within_reach(plan.inputs[0], limits, previous, speed_mps, step_s)
        else:
            wanted, failure = failure_input(limits, previous, speed_mps, step_s), "solver failure"
        driven = self._held_back(memory, plan, wanted, previous, braking) if self._keeps_reserve else wanted
        return driven, failure or (None if driven == wanted else "intervention")

    def _held_back(
        self, memory: Memory, plan: Plan | None, wanted: Input, previous: Input, braking: Input
    ) -> Input:
        """What is driven: the wanted input, an allowed one near it, or braking."""
        doubted = self._reserve.doubted(memory)
        if doubted and plan is not None:
            at_once = self._reserve.braking(memory, self._robot, previous, 0)
            later = self._reserve.braking(memory, self._robot, wanted, 1)
            if self._last_resort.must_brake(memory, doubted, plan, at_once, later):
                return braking
        return self._reserve.nearest_allowed(memory, wanted, previous)


def within_reach(planned: Array, limits: Limits, previous: Input, speed_mps: float, step_s: float) -> Input:
    """What is driven of a planned input (2,).

    Solvers keep limits to a tolerance; what is commanded keeps those of inputs and rates exactly, and that of
    the speed as far as they allow.
    """
    turn_rate, acceleration = planned.tolist()
    slowest, fastest = ((bound - speed_mps) / step_s for bound in (-limits.speed_mps, limits.speed_mps))
    wanted = Input(turn_rate, min(max(acceleration, slowest), fastest))
    return reachable_inputs(limits, previous, step_s).clip(wanted)


def failure_input(limits: Limits, previous: Input, speed_mps: float, step_s: float) -> Input:
    """The publication's rule for a step at which a problem was not solved.

    Going forward (or standing), the lowest reachable acceleration and turn rate; in reverse, the highest.
    """
    lowest, highest = reachable_inputs(limits, previous, step_s)
    return lowest if speed_mps >= 0 else highest


class CommandHistory:
    """The last commands of one robot that came in time, as far as it knows."""

    def __init__(self, robot: str, limits: Limits, step_s: float) -> None:
        self._robot = robot
        self._limits = limits
        self._step_s = step_s
        self._commands: deque[tuple[Command, float]] = deque(maxlen=DOUBTFUL + 1)
        """Each with the speed at its step in m/s."""

    def add(self, command: Command, speed_mps: float) -> None:
        """A command is sent for its step, at which the robot drives at this speed."""
        self._commands.append((command, speed_mps))

    def withdraw(self) -> None:
        """The last command came too late to be sent."""
        self._commands.pop()

    def driven_before(self, step: int) -> Input | None:
        """What the robot drove at the step before; None as long as it has sent no command."""
        return self._driven(*self._commands[-1], step) if self._commands else None

    def previous_input(self, memory: Memory) -> Input:
        """What the robot drove at the step before the present one; recovered from poses without a command.

        Commands that came too late, as far as the robot's own motion shows it, are withdrawn first. Noise can
        hide that; then all of them count as driven.
        """
        seen = memory.previous_input(self._robot)
        if memory.saw_last_step(self._robot):
            driven = [self._driven(*each, memory.step) for each in reversed(self._commands)]
            for late, each in enumerate([*driven, STANDSTILL]):
                if self._is_same(seen, each):
                    for _ in range(late):
                        self.withdraw()
                    break
        driven_before = self.driven_before(memory.step)
        return seen if driven_before is None else driven_before

    def _driven(self, command: Command, speed_mps: float, step: int) -> Input:
        """What was driven before a step if this was the last command in time, sent at that speed.

        Without a command the world brakes the robot: exactly what was driven, up to the noise in the speed.
        """
        driven = self._applied(command.input, speed_mps)
        for _ in range(min(step - command.step - 1, LONGEST_BRAKING_STEPS)):
            speed_mps = speed_after(self._limits, speed_mps, driven, self._step_s)
            driven = self._applied(braking_input(self._limits, driven, speed_mps, self._step_s), speed_mps)
        return driven

    def _applied(self, wanted: Input, speed_mps: float) -> Input:
        """What the world makes of an input at this speed: at its limit the speed stays."""
        after_mps = speed_after(self._limits, speed_mps, wanted, self._step_s)
        if after_mps == speed_mps + self._step_s * wanted.acceleration_mps2:
            return wanted
        return Input(wanted.turn_rate_radps, (after_mps - speed_mps) / self._step_s)

    def _is_same(self, one: Input, other: Input) -> bool:
        """Whether two inputs are equal, up to what is lost when they are recovered from poses."""
        bounds = (self._limits.turn_rate_radps, self._limits.acceleration_mps2)
        return all(abs(a - b) <= SAME * bound for a, b, bound in zip(one, other, bounds, strict=True))
