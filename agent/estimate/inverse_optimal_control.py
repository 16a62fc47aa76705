"""Inverse optimal control (eq. 6): the goal for which an observed stretch of driving was closest to optimal.

The last K_E observed steps are taken as the solution of the shortest-path problem (eq. 2) between their ends.
Its optimality conditions (eq. 5) are linear in the goal L and in the multipliers, so the goal follows from a
convex quadratic program: stationarity and λ ≥ 0 as constraints, multipliers and complementarity in the
objective.
"""

from agent.estimate.constant_acceleration import ConstantAcceleration
from agent.estimate.goals import goal_inside
from agent.estimate.interior_point import solve_inverse
from agent.estimate.inverse_problem import InverseProblem, InverseProblems
from agent.remember.memory import Memory
from agent.solve.vehicle import Array
from protocol.scene import Scene

ITERATIONS = 100
"""Allowed for each robot. About 11 are usual, and 40 where limits are wider by orders of magnitude."""


class InverseOptimalControl:
    """The publication's estimator; the simple model stands in until K_E steps of a robot were seen."""

    goals_are_shared = False

    def __init__(self, scene: Scene) -> None:
        self._area = scene.area
        self._simple = ConstantAcceleration(scene)
        self._problems = InverseProblems(scene)

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`agent.estimate.goals.GoalEstimator`."""
        problems = self._problems.of(memory)
        return {robot: self._estimate_one(memory, robot, problems.get(robot)) for robot in memory.robots}

    def _estimate_one(self, memory: Memory, robot: str, problem: InverseProblem | None) -> Array:
        if problem is not None:
            solution = solve_inverse(problem, ITERATIONS)
            if solution.solved:
                return goal_inside(self._area, problem.states[-1, :3] + solution.goal_offset)
        return self._simple.estimate_one(memory, robot)
