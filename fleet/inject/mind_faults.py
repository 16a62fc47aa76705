"""Kinds of faults of a robot's mind: how it behaves, and what its solver comes to."""

from dataclasses import replace
from typing import ClassVar, Final, Literal

import numpy as np

from agent.solve.problem import JointProblem, Solution
from fleet.inject.fault import NamedRobotFault, RobotFault, Share
from protocol.keys import Id
from protocol.messages import Observation, State
from protocol.scene import Goal, Scene, Weights
from protocol.vehicle import Input, braking_input


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
        )


MIND_FAULTS: Final = (BehaviourFault, SolverFault)
"""Kinds that lie on minds; a robot that none of them befalls is the algorithm itself."""
