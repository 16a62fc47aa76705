"""Trajectories, quadratic programs and recorded problems for the tests of the real-time solver."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from agent_helpers import NEVER, cold, problem_of

from agent.solve import ITERATIONS, joint_solver
from agent.solve.problem import JointProblem, JointSolver, Solution, Start
from agent.solve.realtime.distances import NOBODY
from agent.solve.realtime.kkt import Program
from agent.solve.realtime.sequential import program_about
from agent.solve.realtime.solver import _begin, _units_of
from agent.solve.starts import WarmStarts
from agent.solve.vehicle import Array, rollout

FAR = 1.5
"""Rows with a larger gap are left out of the oracle's programs at first."""


def recorded_programs(problem: JointProblem, steps: range) -> list[Program]:
    """The quadratic programs with which these steps of a closed loop begin, in the solver's units."""
    programs = []
    for each in [*closed_loop(problem, steps.stop)][steps.start :: steps.step]:
        units = _units_of(each.problem)
        data, states, forces, _ = _begin(each.problem, each.start, units)
        programs.append(program_about(data, states, forces, each.problem.price_per_m / units.force))
    return programs


def stages(variables: Array) -> Array:
    """From the order of the variables (..., 2K) to stages 1…K of headings and speeds (..., K, 2)."""
    return variables.reshape(*variables.shape[:-1], -1, 2)[..., ::-1, :].copy()


def driven(path: Array, change: Array, step_s: float) -> Array:
    """The path (K + 1, 4) of one robot after a change (n,) of its headings and speeds, by the rollout."""
    profile = path[:, 2:].astype(np.result_type(path, change))
    profile[1:] += stages(change)
    result = np.concatenate([path[:, :2], profile], axis=1)
    for k in range(len(path) - 1):
        heading, speed = profile[k]
        way = np.array([np.cos(heading), np.sin(heading)]) * speed
        result[k + 1, :2] = result[k, :2] + step_s * way
    return result


def wild_states(random: np.random.Generator, robots: int, steps: int, step_s: float = 0.1) -> Array:
    """Rollouts (M, K + 1, 4) of any inputs."""
    start = random.normal(size=(robots, 4)) * [4.0, 4.0, 2.0, 2.0]
    return rollout(start, random.normal(size=(robots, steps, 2)) * [1.0, 3.0], step_s)


def dense(rows: int, apply: Any) -> Array:
    """The matrix (…, n) of a linear map, from what it does to unit vectors."""
    return np.column_stack([apply(unit) for unit in np.eye(rows)])


def position_jacobian(jacobian: Array) -> Array:
    """∂p_k/∂d of one robot, shape (K + 1, 2, n), from what jacobian mean: later positions all move."""
    steps = len(jacobian) // 2
    result = np.zeros((steps + 1, 2, 2 * steps))
    for j in range(1, steps + 1):
        for slot in (2 * (steps - j), 2 * (steps - j) + 1):
            result[j + 1 :, :, slot] = jacobian[slot]
    return result


def limit_matrix(steps: int, step_s: float) -> Array:
    """A, shape (5K, n): ω, a, their changes, and v, as functions of the headings and speeds."""

    def limited(change: Array) -> Array:
        profile = np.vstack([np.zeros(2), stages(change)])
        inputs = np.diff(profile, axis=0) / step_s
        changes = np.diff(inputs, axis=0, prepend=0.0)
        return np.concatenate([inputs.T.ravel(), changes.T.ravel(), profile[1:, 1]])

    return dense(2 * steps, limited)


@dataclass(frozen=True)
class DenseProgram:
    """min ½ dᵀHd + gᵀd + ρ Σt  s.t.  low ≤ A d ≤ high, gap + C d + t ≥ 0, t ≥ 0, with full matrices."""

    hessian: Array
    gradient: Array
    limits: Array
    low: Array
    high: Array
    rows: Array
    gap: Array
    penalty: float

    def value(self, change: Array) -> float:
        """Of the objective, with the least t there can be."""
        short = np.maximum(-(self.gap + self.rows @ change), 0.0).sum()
        return float(0.5 * change @ self.hessian @ change + self.gradient @ change + self.penalty * short)


def dense_program(program: Program) -> DenseProgram:
    """A program written out with full matrices, from the definitions in its docstrings alone."""
    robots, size = program.gradients.shape
    hessian = np.zeros((robots, size, robots, size))
    jacobians = np.array([position_jacobian(jacobian) for jacobian in program.jacobian])
    for robot, jacobian in enumerate(jacobians):
        hessian[robot, :, robot] = np.einsum("kc,kcm,kcn->mn", program.weights, jacobian, jacobian)
        for stage, (turning, mixed, speeding) in enumerate(program.blocks[robot]):
            here = slice(2 * stage, 2 * stage + 2)
            hessian[robot, here, robot, here] += [[turning, mixed], [mixed, speeding]]
    rows = np.zeros((len(program.rows.gap), robots, size))
    for row, ((i, j), k, normal, _) in enumerate(zip(*program.rows[1:], strict=True)):
        rows[row, i] += normal @ jacobians[i, k]
        if j != NOBODY:
            rows[row, j] -= normal @ jacobians[j, k]
    return DenseProgram(
        hessian=hessian.reshape(robots * size, robots * size),
        gradient=program.gradients.ravel(),
        limits=np.kron(np.eye(robots), limit_matrix(size // 2, program.step_s)),
        low=program.low.ravel(),
        high=program.high.ravel(),
        rows=rows.reshape(len(rows), robots * size),
        gap=program.rows.gap,
        penalty=program.penalty,
    )


def by_the_oracle(program: DenseProgram) -> Array:
    """The solution d by a maintained sparse solver, with a slack variable for every row.

    Rows with much room are left out at first, to save time.
    """
    active = program.gap < FAR
    while True:
        change = _by_the_oracle(program, program.rows[active], program.gap[active])
        broken = (program.gap + program.rows @ change < 0.0) & ~active
        if not broken.any():
            return change
        active |= broken


def _by_the_oracle(program: DenseProgram, rows: Array, gap: Array) -> Array:
    size, count = len(program.gradient), len(gap)
    hessian = np.zeros((size + count, size + count))
    hessian[:size, :size] = program.hessian
    matrix = np.block([[program.limits, np.zeros((len(program.limits), count))], [rows, np.eye(count)]])
    h, a = ca.sparsify(ca.DM(hessian)), ca.sparsify(ca.DM(matrix))
    options = {"piqp": {"eps_abs": 1e-9, "eps_rel": 1e-11, "max_iter": 500}}
    solver = ca.conic("oracle", "piqp", {"h": h.sparsity(), "a": a.sparsity()}, options)
    result = solver(
        h=h,
        g=np.concatenate([program.gradient, np.full(count, program.penalty)]),
        a=a,
        lba=np.concatenate([program.low, -gap]),
        uba=np.concatenate([program.high, np.full(count, np.inf)]),
        lbx=np.concatenate([np.full(size, -np.inf), np.zeros(count)]),
    )
    assert solver.stats()["success"]
    change: Array = result["x"].full().ravel()[:size]
    return change


def random_crossing(robots: int, seed: int, **how: Any) -> JointProblem:
    """Robots that stand on a circle and are bound for about the opposite side, as at the start of a run."""
    random = np.random.default_rng(seed)

    def places() -> Array:
        angles = (np.arange(robots) + random.uniform(-0.25, 0.25, robots)) * math.tau / robots
        return np.column_stack([np.cos(angles), np.sin(angles)]) * random.uniform(3.5, 5.0, (robots, 1))

    starts, goals = places(), np.roll(places(), robots // 2, axis=0)
    headings = np.arctan2(*(goals - starts).T[::-1])
    still = np.zeros(robots)
    ends = (np.column_stack([places, headings, still]) for places in (starts, goals))
    return problem_of(*ends, **how)


@dataclass(frozen=True)
class Recorded:
    """A step of a closed loop: what was to be solved, from where, and what came of it."""

    problem: JointProblem
    start: Start
    solution: Solution


def closed_loop(problem: JointProblem, steps: int, solver: JointSolver | None = None) -> Iterator[Recorded]:
    """Everybody drives the first inputs of the joint solution, again and again."""
    solver = solver or joint_solver("realtime", ITERATIONS, NEVER)
    warm, robots = WarmStarts(), [str(robot) for robot in range(len(problem.states))]
    for _ in range(steps):
        start = warm.start(problem, robots, otherwise=partial(cold, problem))
        solution = solver.solve(problem, start)
        assert solution.solved
        yield Recorded(problem, start, solution)
        warm.keep(robots, solution)
        problem = replace(problem, states=solution.states[:, 1], previous_inputs=solution.inputs[:, 0])
