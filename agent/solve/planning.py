"""Plan: the ego's own problem with its true goal, the others moving as predicted (eq. 1)."""

from dataclasses import dataclass

from agent.remember.memory import Memory
from agent.solve.choice import best_solution
from agent.solve.deadline import Deadline
from agent.solve.prediction import Prediction
from agent.solve.problem import JointSolver
from agent.solve.problems import WarmStarts, joint_problem
from agent.solve.starts import escapes
from agent.solve.vehicle import Array
from protocol.scene import Scene
from protocol.vehicle import Input


@dataclass(frozen=True)
class Plan:
    """What the ego means to do: inputs (n, 2), at least one, and the states (n + 1, 4) they lead through."""

    inputs: Array
    states: Array
    solved: bool


def plan_of(prediction: Prediction, robot: str) -> Plan:
    """With exchanged goals the joint problem is the plan."""
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
