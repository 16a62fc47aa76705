"""``python -m fleet.inject.robot``: one robot's process, as ``python -m agent``, with the faults of its mind.

It is told of the faults by ``UNSPOKEN_FAULTS`` and of the run's seed by ``UNSPOKEN_SEED``.
"""

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from typing import Final

from agent.agent import Agent, Decision
from agent.methods import method_of
from agent.process.options import DecisionOptions, RobotOptions
from agent.process.robot import Decides, run_robot
from agent.solve import Clock, Deadline, joint_solver
from agent.solve.problem import JointProblem, JointSolver, Solution, Start
from chassis.options import with_options
from chassis.refusal import run
from fleet.inject.fault import F, Fault, Scheduled, of_kind
from fleet.inject.mind_faults import MIND_FAULTS, Behaviour, BehaviourFault, SolverFault, pose_of
from fleet.inject.process_faults import ClockStep
from fleet.inject.settings import faults_of_this_process
from protocol.messages import Observation
from protocol.scene import Goal, Scene
from protocol.vehicle import STANDSTILL

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
        self._faults = of_kind(faults, (*MIND_FAULTS, ClockStep), robot)
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
            self._behaviour = behaviour
            self._counts_before = self._counts
            self._begin()
        goal = behaviour.goal(observation, self._home)
        if goal is not None:
            self._drive_to(goal)
        decision = self._agent.decide(behaviour.view(observation, self._robot))
        self._past.append(observation)
        return decision and self._given(decision, observation)

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
        self._agent = Agent(self._robot, self._goal, scene, method, self._clock)
        for seen in self._past:
            self._agent.perception.take_in(self._behaviour.view(seen, self._robot), driven=None)

    def _drive_to(self, goal: Goal) -> None:
        self._agent.goal = goal
        if self._shared is not None:
            self._shared[self._robot] = goal

    def _given(self, decision: Decision, observation: Observation) -> Decision:
        """The decision as its faults have it; its counts go on from before the algorithm began anew."""
        mind, command = decision.mind, decision.command
        self._counts = {name: before + getattr(mind, name) for name, before in self._counts_before.items()}
        mind = mind.model_copy(update={"decision": next(self._ordinals), **self._counts})
        self._is_withdrawn = False
        own = observation.robots[self._robot]
        driven = self._behaviour.driven(self._robot, own, self._previous, self._scene)
        if driven is not None:
            self.withdraw()
            turn_rate, acceleration = driven
            changes = {"turn_rate_radps": turn_rate, "acceleration_mps2": acceleration, "then": None}
            command = command.model_copy(update=changes)
        self._previous = command.input
        return replace(decision, command=command, mind=mind)


class FaultySolver:
    """A solver with the faults of a mind between it and the robot.

    Args:
        solver: the robot's own.
        mind: whose faults strike, or do not, at its present step.
    """

    def __init__(self, solver: JointSolver, mind: FaultyMind) -> None:
        self._solver = solver
        self._mind = mind

    def solve(self, problem: JointProblem, start: Start) -> Solution:
        """See :class:`agent.solve.problem.JointSolver`."""
        faults = self._mind.striking(SolverFault)
        for fault in faults:
            problem = fault.posed(problem)
        solution = self._solver.solve(problem, start)
        for fault in faults:
            solution = fault.solved(solution)
        return solution


class FaultyDeadline(Deadline):
    """One that has passed at once while a fault takes all time.

    Args:
        clock: as of a deadline.
        budget_s: the same.
        mind: whose faults strike, or do not, at its present step.
    """

    def __init__(self, clock: Clock, budget_s: float | None, mind: FaultyMind) -> None:
        super().__init__(clock, budget_s)
        self._mind = mind

    def _is_over(self, question: int) -> bool:
        faults = self._mind.striking(SolverFault)
        return any(fault.takes_all_time for fault in faults) or super()._is_over(question)


class MindOfProcess(FaultyMind):
    """Lives in a process of its own, whose wall clock may jump."""

    def decide(self, observation: Observation) -> Decision | None:
        """See :meth:`agent.agent.Agent.decide`."""
        if steps := of_kind(self._faults, ClockStep):
            step_clock(sum(each.fault.offset_s for each in steps if each.is_on(observation.step)))
        return super().decide(observation)


_time, _time_ns = time.time, time.time_ns


def step_clock(offset_s: float) -> None:
    """From now on the wall clock of this process, as Python tells it, is ahead by so much."""
    offset_ns = round(offset_s * 1e9)
    time.time = lambda: _time() + offset_s
    time.time_ns = lambda: _time_ns() + offset_ns


def make_faulty(options: RobotOptions, scene: Scene) -> Decides:
    """A mind with the faults of the run.

    Raises:
        ValueError: the estimator needs something that the scene does not hold.
    """
    faults, clock = faults_of_this_process(scene), time.perf_counter
    return MindOfProcess(options.robot, options.goal, scene, faults, options, clock)


@with_options(environment=True)
def main(options: RobotOptions) -> None:
    """Be one robot with a mind that has the faults of the run."""
    run_robot(options, make_faulty)


if __name__ == "__main__":
    run(main)
