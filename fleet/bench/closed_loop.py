"""Closed loops of the joint prediction alone: all robots drive what it says, their goals being known."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from agent.estimate.goals import known_goal
from agent.remember.memory import Memory
from agent.solve import ITERATIONS, SolverName, joint_solver
from agent.solve.deadline import Deadline
from agent.solve.multistart import WarmStarts, best_solution
from agent.solve.problem import JointProblem, JointSolver, Solution, Start, joint_problem
from agent.solve.vehicle import Array, rollout
from fleet.bench.durations import Duration, Timer
from protocol.scenario import Scenario
from protocol.vehicle import Input, braking_input

NO_DEADLINE = Deadline(lambda: 0.0, None)
"""The bench measures how long the work takes, so nothing cuts it short."""


@dataclass(frozen=True)
class Solved:
    """One step's problem, where its solution was started from, what came out and how long that took."""

    problem: JointProblem
    starts: Sequence[Start]
    solution: Solution
    duration: Duration
    unsolved: int
    """Starts from which no solution was found."""

    @property
    def warm(self) -> bool:
        """Whether it was solved from the last step's solution."""
        return self.starts[0].warm


class TimedSolver:
    """Solves a step's problem as ``agent.solve.prediction`` does, with a stopwatch.

    Args:
        name: of the solver.
        iterations: of the real-time solver a step, at most.
    """

    def __init__(self, name: SolverName, iterations: int = ITERATIONS) -> None:
        self._solver = _Counting(joint_solver(name, iterations, NO_DEADLINE))

    def solve(self, problem: JointProblem, starts: Sequence[Start]) -> Solved:
        """Solve from each start and take the best solution."""
        before, timer = self._solver.unsolved, Timer()
        solution = best_solution(self._solver, problem, starts, NO_DEADLINE)
        return Solved(problem, starts, solution, timer.read(), self._solver.unsolved - before)


class _Counting:
    """A solver that counts the problems it did not solve."""

    def __init__(self, solver: JointSolver) -> None:
        self._solver = solver
        self.unsolved = 0

    def solve(self, problem: JointProblem, start: Start) -> Solution:
        solution = self._solver.solve(problem, start)
        self.unsolved += not solution.solved
        return solution


def drive(
    scenario: Scenario, solver: TimedSolver, steps: int, first: Start | None = None
) -> Iterator[Solved]:
    """A closed loop: solve, drive the first inputs, shift the solution and solve again.

    It goes on where robots have arrived, so that loops of different solvers stay comparable. Where no
    solution is found, all robots brake for a step.

    Args:
        scenario: whose robots drive.
        solver: what they drive by.
        steps: how many.
        first: where the first solution starts from; None for all cold starts.
    """
    scene = scenario.scene(with_goals=True)
    robots = {robot.id: robot for robot in scenario.robots}
    memory, warm_starts = Memory(2, scene.step_s), WarmStarts()
    states = np.array([robot.start_state() for robot in scenario.robots])
    names = list(robots)
    for step in range(steps):
        memory.remember(step, dict(zip(names, map(tuple, states.tolist()), strict=True)))
        goals = {name: known_goal(robot.goal_pose(), memory.state(name)) for name, robot in robots.items()}
        inputs = {name: memory.previous_input(name) for name in names}
        problem = joint_problem(scene, memory.present(), goals, {}, inputs)
        starts = [first] if first is not None and step == 0 else warm_starts.starts(problem, names)
        solved = solver.solve(problem, starts)
        yield solved
        if solved.solution.solved:
            warm_starts.keep(names, solved.solution)
            driven = solved.solution.inputs[:, :1]
        else:
            warm_starts.forget()
            driven = _braking(problem)
        states = rollout(problem.states, driven, problem.step_s)[:, -1]


def _braking(problem: JointProblem) -> Array:
    """Inputs (M, 1, 2) of one step of braking."""
    inputs = [
        braking_input(limits, Input(*previous), speed, problem.step_s)
        for limits, previous, speed in zip(
            problem.limits, problem.previous_inputs.tolist(), problem.states[:, 3].tolist(), strict=True
        )
    ]
    return np.array(inputs)[:, None]


def cost(loop: Sequence[Solved]) -> float:
    """What the robots drove, by the cost of eq. 11."""
    return float(sum(each.problem.objective(each.problem.states[:, None]) for each in loop))


def shortfall_m(loop: Sequence[Solved]) -> float:
    """By how much two robots came closer than their safety distance while driving, in m; at the worst."""
    return max(0.0, *(_shortfall_m(each.problem) for each in loop))


def passed_alike(one: Sequence[Solved], other: Sequence[Solved]) -> bool:
    """Whether each two robots passed each other on the same side in two loops from the same start.

    That is where both loops turned the line between the two by the same angle, up to less than half a turn.
    """
    differences = np.abs(_turns(one) - _turns(other))
    return bool((differences < np.pi).all())


def _shortfall_m(problem: JointProblem) -> float:
    gaps = (
        problem.safety_distances[i, j] - float(np.hypot(*(problem.states[i, :2] - problem.states[j, :2])))
        for i, j in combinations(range(len(problem.states)), 2)
    )
    return max(gaps, default=0.0)


def _turns(loop: Sequence[Solved]) -> Array:
    """By how much the line between each two robots turned, in rad."""
    positions = np.array([each.problem.states[:, :2] for each in loop])
    ones, others = np.triu_indices(positions.shape[1], 1)
    lines = positions[:, ones] - positions[:, others]
    angles = np.unwrap(np.arctan2(lines[..., 1], lines[..., 0]), axis=0)
    turns: Array = angles[-1] - angles[0]
    return turns
