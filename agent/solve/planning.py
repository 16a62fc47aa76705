"""Plan: the ego's own problem with its true goal, the others moving as predicted (eq. 1)."""

from dataclasses import dataclass

from agent.remember.memory import Memory
from agent.solve import Deadline
from agent.solve.multistart import WarmStarts, best_solution, escapes
from agent.solve.prediction import Prediction
from agent.solve.problem import JointSolver, joint_problem
from agent.solve.vehicle import Array
from protocol.scene import Scene
from protocol.vehicle import Input


@dataclass(frozen=True)
class Plan:
    """What the ego means to do: inputs (n, 2), at least one, and the states (n + 1, 4) they lead through."""

    inputs: Array
    states: Array
    solved: bool


class JointPlan:
    """Plans for one robot where goals are exchanged: the joint problem is its plan."""

    def __init__(self, robot: str) -> None:
        self._robot = robot

    def plan(self, memory: Memory, goal: Array, previous: Input, prediction: Prediction) -> Plan:
        """Its own part of the prediction."""
        robot = self._robot
        return Plan(prediction.inputs[robot], prediction.states[robot], prediction.solved)


class Planner:
    """Plans for one robot.

    Each plan starts from the self-prediction, so that the ego passes the others on the side on which they
    expect it: a start of its own can end in a local minimum on the other side. Where there is none, it starts
    from the last plan, one step on. A plan to stand before somebody for good is compared with turning away.
    """

    def __init__(self, scene: Scene, robot: str, solver: JointSolver, deadline: Deadline) -> None:
        self._scene = scene
        self._robot = robot
        self._solver = solver
        self._deadline = deadline
        self._starts = WarmStarts()

    def plan(self, memory: Memory, goal: Array, previous: Input, prediction: Prediction) -> Plan:
        """Solve eq. 1 for the ego, among the predicted paths of all others."""
        others = {robot: path for robot, path in prediction.paths.items() if robot != self._robot}
        problem = joint_problem(
            self._scene,
            memory.present(),
            {self._robot: goal},
            others,
            {self._robot: previous},
            {robot: memory.caution_m(robot) for robot in others},
        )
        expected = prediction.starts.get(self._robot)
        starts = [expected] if expected else self._starts.starts(problem, [self._robot])
        solution = best_solution(self._solver, problem, starts, self._deadline, escapes)
        if solution.solved:
            self._starts.keep([self._robot], solution)
        else:
            self._starts.forget()
        return Plan(solution.inputs[0], solution.states[0], solution.solved)
