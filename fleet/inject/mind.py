"""Kinds of faults of a robot's mind, of its behaviour and of its solver; and a mind that has them."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Annotated, ClassVar, Final, Literal

import numpy as np
from pydantic import Field

from agent.agent import Agent, Decision
from agent.methods import method_of
from agent.process.options import DecisionOptions
from agent.solve import Clock, Deadline, joint_solver
from agent.solve.problem import JointProblem, JointSolver, Solution, Start
from fleet.inject.fault import F, Fault, NamedRobotFault, RobotFault, Scheduled, Share, of_kind
from protocol.keys import Id
from protocol.messages import Observation, State
from protocol.scene import Goal, Scene, Weights
from protocol.vehicle import STANDSTILL, Input, braking_input


class Behaviour:
    """What stands between a robot's senses, its algorithm, which is that of all others, and its command."""

    def scene(self, scene: Scene) -> Scene:
        """What the robot takes the scene for."""
        return scene

    def view(self, seen: Observation, _robot: str) -> Observation:
        """What it takes notice of."""
        return seen

    def goal(self, _seen: Observation, _home: Goal) -> Goal | None:
        """Where it drives, given where it was first seen; None: where it drove before."""
        return None

    def driven(self, _robot: str, _state: State, _previous: Input, _scene: Scene) -> Input | None:
        """What it drives at its state, after the input of the step before; None: what it decided."""
        return None


class BehaviourFault(Behaviour, NamedRobotFault):
    """The robot does not behave as it should."""


class StopsDead(BehaviourFault):
    """The robot brakes to a standstill and stays there."""

    kind: Literal["stops"]

    def driven(self, robot: str, state: State, previous: Input, scene: Scene) -> Input:
        return braking_input(scene.robot(robot).limits, previous, state.speed_mps, scene.step_s)


class Ignores(BehaviourFault):
    """The robot drives to its goal as if it were alone."""

    kind: Literal["ignores"]

    def view(self, seen: Observation, robot: str) -> Observation:
        return _alone(seen, robot)


class TurnsBack(BehaviourFault):
    """The robot wants to go back to where it started."""

    kind: Literal["turns-back"]

    def goal(self, _seen: Observation, home: Goal) -> Goal:
        return home


class Chases(BehaviourFault):
    """The robot drives at another one, wherever that goes, and minds nobody."""

    kind: Literal["chases"]
    seen: Id

    def view(self, seen: Observation, robot: str) -> Observation:
        return _alone(seen, robot)

    def goal(self, seen: Observation, _home: Goal) -> Goal | None:
        return pose_of(seen.robots[self.seen]) if self.seen in seen.robots else None


class OtherCost(BehaviourFault):
    """The robot weighs its way by another Q than the scene says."""

    kind: Literal["other-cost"]
    weights: Weights

    def scene(self, scene: Scene) -> Scene:
        return scene.model_copy(update={"weights": self.weights})


def pose_of(state: State) -> Goal:
    """A robot's pose as a goal."""
    return Goal(x_m=state.x_m, y_m=state.y_m, heading_rad=state.heading_rad)


def _alone(seen: Observation, robot: str) -> Observation:
    return seen.model_copy(update={"robots": {robot: seen.robots[robot]}})


class SolverFault(RobotFault):
    """Stands between a robot and the solver of its trajectory problems."""

    takes_all_time: ClassVar[bool] = False
    """Whether the time of a decision is over at once."""

    def posed(self, problem: JointProblem) -> JointProblem:
        """The problem that is solved."""
        return problem

    def solved(self, solution: Solution) -> Solution:
        """The solution that the robot gets."""
        return solution


class NoTime(SolverFault):
    """The time budget of every decision is nothing."""

    kind: Literal["no-time"]
    takes_all_time = True


class SolverFailure(SolverFault):
    """At a share of the steps no trajectory problem is solved."""

    kind: Literal["solver-failure"]
    rate: Share = 1.0

    def solved(self, solution: Solution) -> Solution:
        return replace(solution, solved=False)


class Infeasible(SolverFault):
    """An obstacle stands on top of the robot in every trajectory problem: no distance can be kept."""

    kind: Literal["infeasible"]

    def posed(self, problem: JointProblem) -> JointProblem:
        """With an obstacle where its first robot is, as large as that robot."""
        there = np.broadcast_to(problem.states[0, :2], (1, problem.steps + 1, 2))
        return replace(
            problem,
            obstacles=np.concatenate([problem.obstacles, there]),
            safety_distances=np.column_stack([problem.safety_distances, problem.safety_distances[:, 0]]),
            sides=np.column_stack([problem.sides, np.zeros(len(problem.sides))]),
        )


class ClockStep(RobotFault):
    """The wall clock of the robots jumps; nothing may depend on it."""

    kind: Literal["clock-step"]
    offset_s: Annotated[float, Field(ge=-1e9, le=1e9)]
    needs_processes = True


MIND_FAULTS: Final = (BehaviourFault, SolverFault, ClockStep)
"""Kinds that lie on minds; a robot that none of them befalls is the algorithm itself."""
COUNTED: Final = ("solver_failures", "interventions")
"""What a mind counts up from joining an epoch on, however often the algorithm begins anew."""
AS_ALWAYS: Final = Behaviour()


class FaultyMind:
    """One robot, from joining an epoch of the world until that epoch ends, as its faults let it be.

    Of several faults of behaviour at a time, the first in the list counts. Whenever the behaviour changes,
    the algorithm begins anew, with what the robot has seen of late in its memory.

    Args:
        robot: its id.
        goal: its own.
        scene: of the run.
        faults: of the run; those that do not lie on this mind change nothing.
        options: how it decides.
        clock: times its decisions.

    Raises:
        ValueError: the estimator needs something that the scene does not hold.
    """

    def __init__(
        self,
        robot: str,
        goal: Goal,
        scene: Scene,
        faults: Sequence[Scheduled[Fault]],
        options: DecisionOptions,
        clock: Clock,
    ) -> None:
        self._robot, self._goal, self._scene = robot, goal, scene
        self._faults = of_kind(faults, MIND_FAULTS, robot)
        self._options, self._clock = options, clock
        self._step = -1
        self._past: deque[Observation] = deque(maxlen=scene.horizons.estimation_steps + 2)
        self._home: Goal | None = None
        self._behaviour: Behaviour = AS_ALWAYS
        self._previous = STANDSTILL
        self._is_withdrawn = False
        self._ordinals = count()
        self._counts = self._counts_before = dict.fromkeys(COUNTED, 0)
        self._begin()

    def decide(self, observation: Observation) -> Decision | None:
        """See :meth:`agent.agent.Agent.decide`."""
        own = observation.robots.get(self._robot)
        if own is None or observation.step <= self._step:
            return None
        self._step = observation.step
        self._home = self._home or pose_of(own)
        behaviour = next(iter(self.striking(BehaviourFault)), AS_ALWAYS)
        if behaviour is not self._behaviour:
            self._behaviour, self._counts_before = behaviour, self._counts
            self._begin()
        if goal := behaviour.goal(observation, self._home):
            self._agent.goal = goal
            if self._shared is not None:
                self._shared[self._robot] = goal
        decision = self._agent.decide(behaviour.view(observation, self._robot))
        self._past.append(observation)
        return decision and self._given(decision, own)

    def withdraw(self) -> None:
        """See :meth:`agent.agent.Agent.withdraw`."""
        if not self._is_withdrawn:
            self._agent.withdraw()
            self._is_withdrawn = True

    def striking(self, group: type[F]) -> list[F]:
        """The faults of a group that strike at the present step."""
        return [each.fault for each in of_kind(self._faults, group) if each.strike(self._robot, self._step)]

    def _begin(self) -> None:
        """Begin with the past in memory as the present behaviour has it."""
        # A table of its own: where goals are shared, a robot drives to the one that stands there.
        self._shared = None if self._scene.goals is None else dict(self._scene.goals)
        scene = self._behaviour.scene(self._scene.model_copy(update={"goals": self._shared}))
        options = self._options
        deadline = FaultyDeadline(self._clock, options.budget_s, self)
        solver = FaultySolver(joint_solver(options.solver, options.iterations, deadline), self)
        method = method_of(options.goals, scene, self._robot, solver, deadline)
        self._agent = Agent(
            self._robot, self._goal, scene, method, self._clock, keeps_reserve=options.reserve
        )
        for seen in self._past:
            self._agent.perception.take_in(self._behaviour.view(seen, self._robot), driven=None)

    def _given(self, decision: Decision, own: State) -> Decision:
        """The decision as its faults have it; its counts go on from before the algorithm began anew."""
        mind, command = decision.mind, decision.command
        self._counts = {name: before + getattr(mind, name) for name, before in self._counts_before.items()}
        mind = mind.model_copy(update={"decision": next(self._ordinals), **self._counts})
        self._is_withdrawn = False
        driven = self._behaviour.driven(self._robot, own, self._previous, self._scene)
        if driven is not None:
            self.withdraw()
            turn_rate, acceleration = driven
            changes = {"turn_rate_radps": turn_rate, "acceleration_mps2": acceleration}
            command = command.model_copy(update=changes)
        self._previous = command.input
        return replace(decision, command=command, mind=mind)


@dataclass(frozen=True)
class FaultySolver:
    """A robot's solver with the faults of its mind that strike at the present step."""

    solver: JointSolver
    mind: FaultyMind

    def solve(self, problem: JointProblem, start: Start) -> Solution:
        """See :class:`agent.solve.problem.JointSolver`."""
        faults = self.mind.striking(SolverFault)
        for fault in faults:
            problem = fault.posed(problem)
        solution = self.solver.solve(problem, start)
        for fault in faults:
            solution = fault.solved(solution)
        return solution


class FaultyDeadline(Deadline):
    """One that has passed at once while a fault of a mind takes all time."""

    def __init__(self, clock: Clock, budget_s: float | None, mind: FaultyMind) -> None:
        super().__init__(clock, budget_s)
        self._mind = mind

    def _is_over(self, question: int) -> bool:
        faults = self._mind.striking(SolverFault)
        return any(fault.takes_all_time for fault in faults) or super()._is_over(question)
