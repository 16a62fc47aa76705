"""Algorithm 1: remember, estimate, predict, plan, act. No input or output, no clock, no thread."""

from dataclasses import dataclass, field
from itertools import count
from typing import Self

from agent.drive.commands import GivenCommands, first_input, second_input, without_a_plan
from agent.drive.monitor import CollisionMonitor
from agent.drive.vigilance import Vigilance
from agent.estimate import GoalsName
from agent.estimate.interface import known_goal
from agent.methods import Method, method_of
from agent.remember.perception import Perception
from agent.solve import ITERATIONS, SolverName, joint_solver
from agent.solve.deadline import Clock, Deadline, Stopwatch
from agent.solve.planning import Plan, plan_of
from agent.solve.prediction import Prediction
from agent.solve.vehicle import Array
from protocol.arrival import has_arrived
from protocol.messages import Command, Degradation, Mind, Observation, Phase, Positions, State
from protocol.scene import Goal, Scene
from protocol.vehicle import Input, Limits, braking_input


@dataclass(frozen=True)
class Decision:
    """What a robot does at a step, and what it thought."""

    command: Command
    mind: Mind


@dataclass
class _Thought:
    """What one turn of the algorithm came to; a robot that has arrived thinks nothing."""

    goals: dict[str, Array] = field(default_factory=dict)
    prediction: Prediction | None = None
    plan: Plan | None = None

    @property
    def failed(self) -> tuple[Phase, ...]:
        """Phases whose problem was not solved. A failed prediction leaves nothing to plan with."""
        if self.prediction is not None and not self.prediction.solved:
            return ("predict",)
        if self.plan is not None and not self.plan.solved:
            return ("plan",)
        return ()


class Agent:
    """One robot, from joining an epoch of the world until that epoch ends.

    Args:
        robot: this robot's id.
        goal: its own goal, which it tells nobody.
        scene: what everybody may know.
        method: its estimator, predictor and planner, made for this robot and scene.
        clock: times the phases for ``mind``; it changes no decision.

    Attributes:
        goal: where it drives from the next decision on; another one may be set.
        perception: what it has seen so far; :meth:`decide` adds to it.
    """

    def __init__(
        self,
        robot: str,
        goal: Goal,
        scene: Scene,
        method: Method,
        clock: Clock,
    ) -> None:
        self._robot = robot
        self.goal = goal
        self._scene = scene
        self._clock = clock
        self.perception = Perception(scene, robot)
        self._memory = self.perception.memory
        self._estimator, self._predictor, self._planner, self._deadline = method
        self._vigilance = Vigilance(scene, robot)
        self._monitor = CollisionMonitor(scene, robot)
        self._arrived_at: Goal | None = None
        self._parked: set[str] = set()
        self._given = GivenCommands(self._limits, scene.step_s)
        self._solver_failures = 0
        self._ordinals = count()

    @classmethod
    def of(
        cls,
        robot: str,
        goal: Goal,
        scene: Scene,
        *,
        goals: GoalsName,
        solver: SolverName,
        clock: Clock,
        iterations: int = ITERATIONS,
        deadline: Deadline | None = None,
    ) -> Self:
        """A robot with the method and the solver of these names.

        Args:
            robot: as of the class.
            goal: as of the class.
            scene: as of the class.
            goals: how it comes to know what the others will do: a name that ``agent.methods`` knows.
            solver: of trajectory problems: a name that ``agent.solve.joint_solver`` knows.
            clock: as of the class.
            iterations: of the real-time solver a problem, at most.
            deadline: after it a decision improves its trajectories no further; None for no limit.

        Raises:
            ValueError: the estimator needs something that the scene does not hold.
            ModuleNotFoundError: ORCA's library is not installed.
        """
        deadline = deadline or Deadline(clock, None)
        method = method_of(goals, scene, robot, joint_solver(solver, iterations, deadline), deadline)
        return cls(robot, goal, scene, method, clock)

    def decide(self, observation: Observation) -> Decision | None:
        """One turn of algorithm 1.

        Returns:
            The decision; None for an observation that is not newer than the last one or lacks this robot, and
            as long as this robot cannot know where it is.
        """
        if self._robot not in observation.robots or observation.step <= self._memory.step:
            return None
        refused = self.perception.take_in(observation, self._given.driven_before(observation.step))
        if self._robot not in self._memory.robots:
            return None
        watch = Stopwatch(self._clock)
        self._deadline.begin()
        if self._memory.saw_last_step(self._robot):
            self._given.withdraw_late(self._memory.previous_input(self._robot), self._memory.step)
        self._arrived_at = self.goal if self._has_arrived() else None
        thought = _Thought() if self._arrived else self._think(watch)
        self._solver_failures += len(thought.failed)
        self._monitor.watch(self._memory, thought.prediction, observation.accuracy)
        self._vigilance.look(self._memory, observation.age_steps)
        control, then, emergency = self._act(thought)
        command = Command(
            epoch=observation.epoch,
            robot=self._robot,
            step=observation.step,
            turn_rate_radps=control.turn_rate_radps,
            acceleration_mps2=control.acceleration_mps2,
            then=then,
        )
        self._given.add(command, self._speed_mps())
        degraded = self._degradations(observation, thought, refused, emergency)
        return Decision(command, self._mind(observation, thought, degraded, watch))

    def withdraw(self) -> None:
        """Take back the command of the last decision, which came too late to be given."""
        self._given.withdraw()

    @property
    def _arrived(self) -> bool:
        return self._arrived_at is not None

    def _has_arrived(self) -> bool:
        """For good, if it was seen without noise; otherwise only as long as it looks like that."""
        for_good = self._arrived_at == self.goal and self._memory.is_exact(self._robot)
        return for_good or self._is_at(self.goal, self._robot)

    def _think(self, watch: Stopwatch) -> _Thought:
        with watch.phase("estimate"):
            goals = self._estimator.estimate(self._memory)
        with watch.phase("predict"):
            prediction = self._predictor.predict(self._memory, goals, self._known_parked())
        if not prediction.solved:
            return _Thought(goals, prediction)
        with watch.phase("plan"):
            plan = self._plan(prediction)
        return _Thought(goals, prediction, plan)

    def _plan(self, prediction: Prediction) -> Plan:
        if self._estimator.goals_are_shared:
            return plan_of(prediction, self._robot)
        goal = known_goal(self.goal, self._memory.state(self._robot))
        return self._planner.plan(self._memory, goal, self._previous_input(), prediction)

    def _act(self, thought: _Thought) -> tuple[Input, Input | None, Degradation | None]:
        """The input of this step; where there is a plan, that of the next one; and why it is not followed."""
        limits, previous = self._limits, self._previous_input()
        speed, step_s = self._speed_mps(), self._scene.step_s
        if self._arrived:
            return braking_input(limits, previous, speed, step_s), None, None
        if self._vigilance.is_blind(self._memory):
            return braking_input(limits, previous, speed, step_s), None, "controlled stop"
        if thought.failed or thought.plan is None:
            return without_a_plan(limits, previous, speed, step_s), None, "solver failure"
        first = first_input(thought.plan, limits, previous, speed, step_s)
        if self._monitor.must_brake(self._memory, thought.plan, first, previous):
            return braking_input(limits, previous, speed, step_s), None, "intervention"
        return first, second_input(thought.plan, limits, first, speed, step_s), None

    def _degradations(
        self, observation: Observation, thought: _Thought, refused: set[str], emergency: Degradation | None
    ) -> tuple[Degradation, ...]:
        """In which ways this decision was not as it should be."""
        others = (robot for robot in self._memory.robots if robot != self._robot)
        unseen = any(self._memory.unseen_steps(robot) > observation.age_steps for robot in others)
        found: dict[Degradation, bool] = {
            "extrapolation": unseen,
            "gate": bool(refused),
            "controlled stop": emergency == "controlled stop",
            "solver failure": bool(thought.failed),
            "intervention": emergency == "intervention",
        }
        return tuple(degradation for degradation, is_so in found.items() if is_so)

    def _previous_input(self) -> Input:
        """What this robot drove at the step before; recovered from poses until it has given a command."""
        driven = self._given.driven_before(self._memory.step)
        return self._memory.previous_input(self._robot) if driven is None else driven

    @property
    def _limits(self) -> Limits:
        return self._scene.robot(self._robot).limits

    def _speed_mps(self) -> float:
        return float(self._memory.state(self._robot)[3])

    def _known_parked(self) -> set[str]:
        """Other robots known to have arrived: only where goals are shared.

        A parked robot stays parked; under noise it may only have looked like one.
        """
        shared = self._scene.goals if self._estimator.goals_are_shared else None
        present = set(self._memory.robots)
        self._parked -= {robot for robot in present if not self._memory.is_exact(robot)}
        for robot in present - {self._robot}:
            if shared is not None and robot in shared and self._is_at(shared[robot], robot):
                self._parked.add(robot)
        return self._parked & present

    def _is_at(self, goal: Goal, robot: str) -> bool:
        state = self._memory.state(robot).tolist()
        return has_arrived(state, goal.as_state(), self._scene.arrival_tolerance)

    def _mind(
        self,
        observation: Observation,
        thought: _Thought,
        degraded: tuple[Degradation, ...],
        watch: Stopwatch,
    ) -> Mind:
        return Mind(
            epoch=observation.epoch,
            robot=self._robot,
            step=observation.step,
            decision=next(self._ordinals),
            arrived=self._arrived,
            estimates={robot: State.of(*goal.tolist()) for robot, goal in thought.goals.items()},
            prediction={
                robot: _as_path(path)
                for robot, path in (thought.prediction.paths if thought.prediction else {}).items()
            },
            plan=_as_path(thought.plan.states) if thought.plan else (),
            failed=thought.failed,
            solver_failures=self._solver_failures,
            degraded=degraded,
            interventions=self._monitor.interventions,
            cut_short_at=self._deadline.cut_short_at,
            timings_ms=watch.timings(),
        )


def _as_path(positions: Array) -> Positions:
    return tuple(map(tuple, positions[:, :2].tolist()))
