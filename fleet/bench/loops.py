"""Robots that get in one another's way, and closed loops in which they drive by the joint prediction."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np

from agent.estimate.goals import known_goal
from agent.remember.memory import Memory
from agent.solve import ITERATIONS, Deadline, SolverName, joint_solver
from agent.solve.problem import JointProblem, Solution, Start, braking_inputs, joint_problem
from agent.solve.starts import WarmStarts, cold_start
from agent.solve.vehicle import Array, rollout
from fleet.bench.measuring import clocks_ms
from protocol.scenario import Pose, Scenario, ScenarioRobot

SPACING_M = 1.5
"""Least distance of two starts and of two goals; robots park safely from 1.39 m on."""
SMALLEST_M = 4.0
"""Half the side of the square, or the radius of the circle, for few robots: that of scenario 8a."""
NO_DEADLINE = Deadline(lambda: 0.0, None)
"""The bench measures how long the work takes, so nothing cuts it short."""

Points = list[tuple[float, float]]


def circle(robots: int) -> Scenario:
    """Robots on a circle, each with its goal at the opposite point."""
    radius_m = max(SMALLEST_M, 0.28 * robots)
    turns = [math.tau * index / robots for index in range(robots)]
    starts = [(radius_m * math.cos(turn), radius_m * math.sin(turn)) for turn in turns]
    return _scenario(f"circle {robots}", starts, [(-x_m, -y_m) for x_m, y_m in starts])


def random_crossing(robots: int, seed: int) -> Scenario:
    """Robots with starts and goals drawn from the border of a square, which grows with their number.

    Args:
        robots: 1 to ``MOST_ROBOTS``.
        seed: the same one gives the same scenario.
    """
    generator = np.random.default_rng(seed)
    half_m = SMALLEST_M * max(1.0, math.sqrt(robots / 8.0))
    starts, goals = (_on_a_square(generator, robots, half_m) for _ in range(2))
    return _scenario(f"random {robots} seed {seed}", starts, goals)


def _on_a_square(generator: np.random.Generator, count: int, half_m: float) -> Points:
    """Points in random order; all placings that keep ``SPACING_M`` are equally probable."""
    perimeter_m = 8.0 * half_m
    while True:
        # Random gaps come on top of the least ones, so that only points around a corner can be too close.
        free_m = np.sort(generator.uniform(0.0, perimeter_m - count * SPACING_M, count))
        along_m = free_m + SPACING_M * np.arange(count) + generator.uniform(0.0, perimeter_m)
        points = [_border_point(along, half_m) for along in generator.permutation(along_m % perimeter_m)]
        if all(math.dist(one, other) >= SPACING_M for one, other in combinations(points, 2)):
            return points


def _border_point(along_m: float, half_m: float) -> tuple[float, float]:
    """The point of a square's border at this length along it."""
    side, offset_m = divmod(float(along_m), 2.0 * half_m)
    x_m, y_m = offset_m - half_m, -half_m
    for _ in range(int(side)):
        x_m, y_m = -y_m, x_m
    return x_m, y_m


def _scenario(name: str, starts: Points, goals: Points) -> Scenario:
    robots = [
        ScenarioRobot(id=str(index), start=Pose(x_m=x_m, y_m=y_m), goal=Pose(x_m=goal_x_m, y_m=goal_y_m))
        for index, ((x_m, y_m), (goal_x_m, goal_y_m)) in enumerate(zip(starts, goals, strict=True), 1)
    ]
    return Scenario(name=name, robots=robots)


@dataclass(frozen=True)
class Solved:
    """One step's problem, where its solution was started from, what came out and how long that took."""

    problem: JointProblem
    start: Start
    solution: Solution
    duration_ms: Array
    """As of :func:`fleet.bench.measuring.clocks_ms`."""


class TimedSolver:
    """Solves a step's problem, with a stopwatch.

    Args:
        name: of the solver.
    """

    def __init__(self, name: SolverName) -> None:
        self._solver = joint_solver(name, ITERATIONS, NO_DEADLINE)

    def solve(self, problem: JointProblem, start: Start) -> Solved:
        """Solve from a start."""
        begin_ms = clocks_ms()
        solution = self._solver.solve(problem, start)
        return Solved(problem, start, solution, clocks_ms() - begin_ms)


def drive(
    scenario: Scenario, solver: TimedSolver, steps: int, first: Start | None = None
) -> Iterator[Solved]:
    """A closed loop: solve, drive the first inputs, shift the solution and solve again.

    It goes on after robots have arrived, so that the loops of different solvers can be compared. Where no
    solution is found, all robots brake for a step.

    Args:
        scenario: whose robots drive, all goals being known.
        solver: what they drive by.
        steps: how many.
        first: where the first solution starts from; None for robots that brake, leaning to their left.
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
        begin = cold_start(problem) if step else first or _leaning(problem)
        start = warm_starts.start(problem, names, otherwise=partial(replace, begin))
        solved = solver.solve(problem, start)
        yield solved
        warm_starts.keep(names, solved.solution)
        inputs_found = solved.solution.inputs if solved.solution.solved else braking_inputs(problem)
        driven = inputs_found[:, :1]
        states = rollout(problem.states, driven, problem.step_s)[:, -1]


def _leaning(problem: JointProblem) -> Start:
    """All brake while they turn to their left, so that a symmetrical crossing begins as a roundabout."""
    start = cold_start(problem)
    start.inputs[:, :, 0] += problem.rate_bounds[:, :1]
    return start


def cost(loop: Sequence[Solved]) -> float:
    """What the robots drove, by the cost of eq. 11."""
    squares = [each.problem.weights[0] * (each.problem.states - each.problem.goals) ** 2 for each in loop]
    return float(np.sum(squares))


def shortfall_m(loop: Sequence[Solved]) -> float:
    """By how much two robots came closer than their safety distance while driving, in m; at the worst."""
    safe_m = loop[0].problem.safety_distances[np.triu_indices(len(loop[0].problem.states), 1)]
    return float((safe_m - np.linalg.norm(_lines(loop), axis=-1)).max(initial=0.0))


def passed_alike(one: Sequence[Solved], other: Sequence[Solved]) -> bool:
    """Whether, in two loops from the same start, any two robots passed each other on the same side.

    They did if both loops turned the line between the two by the same angle, up to less than half a turn.
    """
    return bool((np.abs(_turns_rad(one) - _turns_rad(other)) < np.pi).all())


def _turns_rad(loop: Sequence[Solved]) -> Array:
    """By how much the line between any two robots turned, shape (pairs,)."""
    x_m, y_m = np.moveaxis(_lines(loop), -1, 0)
    angles = np.unwrap(np.arctan2(y_m, x_m), axis=0)
    turns: Array = angles[-1] - angles[0]
    return turns


def _lines(loop: Sequence[Solved]) -> Array:
    """From one robot to another, in m, shape (steps, pairs, 2)."""
    positions = np.array([each.problem.states[:, :2] for each in loop])
    ones, others = np.triu_indices(positions.shape[1], 1)
    lines: Array = positions[:, ones] - positions[:, others]
    return lines
