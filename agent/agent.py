"""Algorithm 1: remember, estimate, predict, plan, act. No input or output, no clock, no thread."""

from dataclasses import dataclass

from agent.drive.commands import Driver
from agent.estimate.goals import known_goal
from agent.methods import Method
from agent.remember.perception import Perception
from agent.solve import Clock
from agent.telemetry import Telemetry, Thought
from protocol.messages import Command, Mind, Observation
from protocol.scene import Goal, Scene


@dataclass(frozen=True)
class Decision:
    """What a robot does at a step, and what it thought."""

    command: Command
    mind: Mind


class Agent:
    """One robot, from joining an epoch of the world until that epoch ends.

    Args:
        robot: this robot's id.
        goal: its own goal, which it tells nobody.
        scene: what everybody may know.
        method: its estimator, predictor and planner, made for this robot and scene.
        clock: times the phases for ``mind``; it changes no decision.
        keeps_reserve: see :class:`agent.drive.commands.Driver`.

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
        *,
        keeps_reserve: bool = True,
    ) -> None:
        self.goal = goal
        self.perception = Perception(scene, robot)
        self._robot = robot
        self._scene = scene
        self._method = method
        self._driver = Driver(scene, robot, keeps_reserve=keeps_reserve)
        self._telemetry = Telemetry(robot, clock)

    def decide(self, observation: Observation) -> Decision | None:
        """One turn of algorithm 1.

        Returns:
            The decision; None for an observation that is not newer than the last one or lacks this robot, and
            as long as this robot cannot know where it is.
        """
        robot, memory, history = self._robot, self.perception.memory, self._driver.history
        estimator, predictor, planner, deadline = self._method
        if robot not in observation.robots or observation.step <= memory.step:
            return None
        refused = self.perception.take_in(observation, history.driven_before(observation.step))
        if robot not in memory.robots:
            return None
        self._telemetry.begin()
        deadline.begin()
        previous = history.previous_input(memory)
        room = self._driver.look(observation, memory, previous)
        thought = Thought(refused, self.perception.has_arrived(self.goal))
        if not thought.arrived:
            with self._telemetry.phase("estimate"):  # eq. 6
                thought.goals = estimator.estimate(memory)
            with self._telemetry.phase("predict"):  # eq. 7
                shared = (self._scene.goals if estimator.goals_are_shared else None) or {}
                thought.prediction = predictor.predict(memory, thought.goals, self.perception.parked(shared))
            if thought.prediction.solved:
                with self._telemetry.phase("plan"):  # eq. 1
                    goal = known_goal(self.goal, memory.state(robot))
                    thought.plan = planner.plan(memory, goal, previous, thought.prediction, room)
        command = self._driver.act(observation, memory, previous, thought)
        interventions = self._driver.interventions
        mind = self._telemetry.mind(observation, memory, thought, interventions, deadline.cut_short_at)
        return Decision(command, mind)

    def withdraw(self) -> None:
        """Take back the command of the last decision, which came too late to be sent."""
        self._driver.history.withdraw()
