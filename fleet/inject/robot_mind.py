"""A robot's mind with the faults of a run on its behaviour and on its solver."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import count
from typing import Any, Final, Protocol

from agent.agent import Agent, Decision
from agent.solve.deadline import Clock, Deadline
from agent.solve.problem import JointSolver
from fleet.inject.behaving import BEHAVIOURS, Behaviour, given_instead, place_of
from fleet.inject.schedule import Scheduled
from fleet.inject.solving import StruckDeadline, StruckSolver
from protocol.faults import Fault, Infeasible, NoTime, SolverFailure
from protocol.messages import Observation
from protocol.scene import Goal, Scene
from protocol.vehicle import STANDSTILL

MIND_KINDS: Final[tuple[type[Any], ...]] = (*BEHAVIOURS, NoTime, SolverFailure, Infeasible)
"""The kinds of faults that lie on minds."""

COUNTED: Final = ("solver_failures", "interventions")
"""What a mind counts up from joining an epoch on, however often the algorithm begins anew."""


class MakeAgent(Protocol):
    """Makes a robot's algorithm, which has not seen anything yet."""

    def __call__(
        self, scene: Scene, deadline: Deadline, through: Callable[[JointSolver], JointSolver], /
    ) -> Agent:
        """An agent with this deadline, whose trajectory problems go through that on the way to its solver.

        Raises:
            ValueError: the estimator needs something that the scene does not hold.
        """


def mind_faults(faults: Iterable[Scheduled[Fault]], robot: str) -> list[Scheduled[Any]]:
    """Those that lie on the mind of a robot; without any, it is the algorithm itself."""
    return [each for each in faults if isinstance(each.fault, MIND_KINDS) and each.befalls(robot)]


class RobotMind:
    """One robot, from joining an epoch of the world until that epoch ends, as its faults let it be.

    Of several faults of behaviour at a time, the first in the list counts. Whenever the behaviour changes,
    the algorithm begins anew, with what the robot has seen of late in its memory.

    Args:
        make: makes the algorithm, given the scene as it is, or as a fault has it.
        robot: its id.
        scene: of the run.
        faults: of the run; those that do not lie on this mind change nothing.
        clock: times decisions.
        budget_s: what a decision may take; None for no limit.

    Raises:
        ValueError: the estimator needs something that the scene does not hold.
    """

    def __init__(
        self,
        make: MakeAgent,
        robot: str,
        scene: Scene,
        faults: Sequence[Scheduled[Fault]],
        *,
        clock: Clock,
        budget_s: float | None = None,
    ) -> None:
        self._make = make
        self._robot = robot
        self._scene = scene
        self._faults = mind_faults(faults, robot)
        self._clock = clock
        self._budget_s = budget_s
        self._step = -1
        self._past: deque[Observation] = deque(maxlen=scene.horizons.estimation_steps + 2)
        self._home: Goal | None = None
        self._fault: Scheduled[Any] | None = None
        self._behaviour = Behaviour(None, robot, Goal(x_m=0.0, y_m=0.0, heading_rad=0.0))
        self._driven_to: Goal | None = None
        self._given = STANDSTILL
        self._is_withdrawn = False
        self._ordinals = count()
        self._counts = self._counts_before = dict.fromkeys(COUNTED, 0)
        self._agent = self._begun()

    def decide(self, observation: Observation) -> Decision | None:
        """See :meth:`agent.agent.Agent.decide`."""
        own = observation.robots.get(self._robot)
        if own is None or observation.step <= self._step:
            return None
        self._step = observation.step
        self._home = self._home or place_of(own)
        self._behave(self._home)
        self._drive_to(self._behaviour.goal(observation))
        decision = self._agent.decide(self._behaviour.view(observation))
        self._past.append(observation)
        return decision and self._said(decision, observation)

    def withdraw(self) -> None:
        """See :meth:`agent.agent.Agent.withdraw`."""
        if not self._is_withdrawn:
            self._agent.withdraw()
            self._is_withdrawn = True

    def _behave(self, home: Goal) -> None:
        """Change the behaviour where a fault of it begins or ends."""
        on = (each for each in self._faults if type(each.fault) in BEHAVIOURS and each.is_on(self._step))
        fault = next(on, None)
        if fault is self._fault:
            return
        self._fault = fault
        kind = Behaviour if fault is None else BEHAVIOURS[type(fault.fault)]
        self._behaviour = kind(fault and fault.fault, self._robot, home)
        self._counts_before = self._counts
        self._agent = self._begun()

    def _begun(self) -> Agent:
        """The algorithm, with the past in its memory as the present behaviour has it."""
        goals = self._scene.goals
        # A table of its own: where goals are told, a robot drives to the one that stands there.
        self._goals = None if goals is None else dict(goals)
        scene = self._behaviour.scene(self._scene.model_copy(update={"goals": self._goals}))
        deadline = StruckDeadline(self._clock, self._budget_s, self._struck)
        agent = self._make(scene, deadline, lambda solver: StruckSolver(solver, self._struck))
        self._driven_to = None
        for seen in self._past:
            agent.perception.take_in(self._behaviour.view(seen), driven=None)
        return agent

    def _drive_to(self, goal: Goal | None) -> None:
        if goal is None or goal == self._driven_to:
            return
        self._driven_to = goal
        if self._goals is not None:
            self._goals[self._robot] = goal
        self._agent.goal = goal

    def _said(self, decision: Decision, observation: Observation) -> Decision:
        """What the robot says of its decision, counted on from before the algorithm began anew."""
        mind = decision.mind
        self._counts = {name: before + getattr(mind, name) for name, before in self._counts_before.items()}
        mind = mind.model_copy(update={"decision": next(self._ordinals), **self._counts})
        said = replace(decision, mind=mind)
        self._is_withdrawn = False
        wanted = self._behaviour.input(observation.robots[self._robot], self._given, self._scene)
        if wanted is not None:
            self.withdraw()
            said = replace(said, command=given_instead(said.command, wanted))
        self._given = said.command.input
        return said

    def _struck(self, kind: type[Any]) -> bool:
        return any(
            isinstance(each.fault, kind) and each.strikes(self._robot, self._step) for each in self._faults
        )
