"""The reference solver: the joint problem written out in CasADi and solved by IPOPT, as the publication does.

It is the judge of every faster solver, so it stays close to the equations: direct multiple shooting, every
distance row present, all derivatives exact.
"""

from dataclasses import dataclass
from itertools import combinations

import casadi as ca
import numpy as np

from agent.solve.problem import (
    FIRST_FREE_STAGE,
    LIMITED_QUANTITIES,
    JointProblem,
    Solution,
    Start,
    braking_inputs,
    within_limits,
)
from agent.solve.vehicle import Array

PENALTY_PER_M2 = 1e4
"""Weight of a violated distance row d² − ‖Δp‖² ≤ 0; far above the multipliers of crossings, so exact."""

ROOM = 1e-2
"""Room in m and m/s around a braking vehicle where bounds are widened for it: IPOPT needs an interior, and
takes some problems for infeasible with a tenth of this."""

IPOPT_OPTIONS: dict[str, bool | int | float | str] = {
    "print_time": False,
    "calc_lam_p": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.mu_init": 1e-2,  # the shifted last plan is a good start: begin near the central path's end
    "ipopt.max_iter": 500,
}


@dataclass(frozen=True)
class _Program:
    """One compiled nonlinear program for M robots, O obstacles and K steps."""

    solver: ca.Function
    pairs: tuple[tuple[int, int], ...]
    """Index of a robot and of another robot or obstacle, in the order of the distance rows."""


class ReferenceSolver:
    """IPOPT on the full problem. Compiled programs are kept by their size."""

    def __init__(self) -> None:
        self._programs: dict[tuple[int, int, int, float], _Program] = {}

    def solve(self, problem: JointProblem, start: Start) -> Solution:
        """See :class:`agent.solve.problem.JointSolver`."""
        size = (len(problem.states), len(problem.obstacles), problem.steps, problem.step_s)
        if size not in self._programs:
            self._programs[size] = _compile(*size)
        program = self._programs[size]
        result = program.solver(
            x0=_variables(problem, start.inputs, len(program.pairs)),
            p=_parameters(problem, program.pairs),
            **_bounds(problem, len(program.pairs)),
        )
        statistics = program.solver.stats()
        inputs = within_limits(problem, _inputs_of(problem, np.asarray(result["x"]).ravel()))
        finite = bool(np.isfinite(inputs).all())
        inputs = inputs if finite else within_limits(problem, start.inputs)
        states = problem.rollout(inputs)
        return Solution(
            inputs=inputs,
            states=states,
            forces=_forces(problem, states, np.asarray(result["lam_g"]).ravel(), program.pairs),
            limit_multipliers=np.zeros((len(states), problem.steps, LIMITED_QUANTITIES)),
            objective=problem.objective(states),
            violation_m=problem.violation_m(states),
            solved=finite and bool(statistics["success"]),
            iterations=int(statistics["iter_count"]),
        )


def symbolic_step(state: ca.SX, control: ca.SX, step_s: float) -> ca.SX:
    """f(x, u) of eq. 8 for one robot, as a CasADi expression of shape (4, 1)."""
    heading, speed = state[2], state[3]
    rates = ca.vertcat(speed * ca.cos(heading), speed * ca.sin(heading), control[0], control[1])
    return state + step_s * rates


def _compile(robots: int, obstacles: int, steps: int, step_s: float) -> _Program:
    """Write eq. 7 out.

    Variables: states (4, M) of stages 1…K, inputs (2, M) of stages 0…K − 1, one slack a distance row.
    Rows: dynamics, input rates, distances.
    """
    pairs = (
        *combinations(range(robots), 2),
        *((robot, robots + obstacle) for robot in range(robots) for obstacle in range(obstacles)),
    )
    states = [ca.SX.sym(f"x_{k}", 4, robots) for k in range(steps + 1)]
    inputs = [ca.SX.sym(f"u_{k}", 2, robots) for k in range(-1, steps)]
    slacks = [ca.SX.sym(f"s_{k}", len(pairs)) for k in range(FIRST_FREE_STAGE, steps + 1)]
    goals = ca.SX.sym("L", 4, robots)
    weights = ca.SX.sym("q", 4, steps + 1)
    others = [ca.SX.sym(f"o_{k}", 2, obstacles) for k in range(FIRST_FREE_STAGE, steps + 1)]
    distances = ca.SX.sym("d", len(pairs))

    cost = PENALTY_PER_M2 * ca.sum1(ca.vertcat(0, *slacks))
    for k, stage in enumerate(states):
        cost += ca.sum1(ca.mtimes(weights[:, k].T, (stage - goals) ** 2).T)
    dynamics = [
        states[k + 1][:, i] - symbolic_step(states[k][:, i], inputs[k + 1][:, i], step_s)
        for k in range(steps)
        for i in range(robots)
    ]
    rates = [ca.vec(inputs[k + 1] - inputs[k]) for k in range(steps)]
    clearances = []
    for stage, other, slack in zip(states[FIRST_FREE_STAGE:], others, slacks, strict=True):
        positions = ca.horzcat(stage[:2, :], other)
        for row, (i, j) in enumerate(pairs):
            gap = positions[:, i] - positions[:, j]
            clearances.append(ca.sumsqr(gap) - distances[row] ** 2 + slack[row])
    program = {
        "x": ca.vertcat(*map(ca.vec, states[1:]), *map(ca.vec, inputs[1:]), *slacks),
        "p": ca.vertcat(
            ca.vec(states[0]),
            ca.vec(inputs[0]),
            ca.vec(goals),
            ca.vec(weights),
            *map(ca.vec, others),
            distances,
        ),
        "f": cost,
        "g": ca.vertcat(*dynamics, *rates, *clearances),
    }
    return _Program(ca.nlpsol("joint", "ipopt", program, IPOPT_OPTIONS), pairs)


def _forces(
    problem: JointProblem, states: Array, multipliers: Array, pairs: tuple[tuple[int, int], ...]
) -> Array:
    """The forces of the distance rows, from the multipliers of all rows. Those of the area are left out."""
    forces = np.zeros((len(problem.states), problem.steps + 1, 2))
    stages = problem.steps + 1 - FIRST_FREE_STAGE
    rows = multipliers[6 * len(problem.states) * problem.steps :].reshape(stages, len(pairs))
    everybody = np.concatenate([states[:, :, :2], problem.obstacles])
    for pair, (i, j) in enumerate(pairs):
        # A row is ‖Δp‖² − d²: its gradient in p_i is 2 Δp.
        gap = (everybody[i] - everybody[j])[FIRST_FREE_STAGE:]
        push = -2.0 * rows[:, pair, None] * gap
        forces[i, FIRST_FREE_STAGE:] += push
        if j < len(forces):
            forces[j, FIRST_FREE_STAGE:] -= push
    return forces


def _variables(problem: JointProblem, guess: Array, pairs: int) -> Array:
    states = problem.rollout(guess)[:, 1:]
    slacks = np.zeros(pairs * (problem.steps + 1 - FIRST_FREE_STAGE))
    return np.concatenate([_by_stage(states), _by_stage(guess), slacks])


def _inputs_of(problem: JointProblem, variables: Array) -> Array:
    """The inputs (M, K, 2) among the variables."""
    robots, steps = len(problem.states), problem.steps
    flat = variables[4 * robots * steps :][: 2 * robots * steps]
    return flat.reshape(steps, robots, 2).transpose(1, 0, 2)


def _parameters(problem: JointProblem, pairs: tuple[tuple[int, int], ...]) -> Array:
    # Inputs recovered from noisy poses can lie further outside the limits than the rates lead back in a step.
    previous = np.clip(problem.previous_inputs, -problem.input_bounds, problem.input_bounds)
    return np.concatenate(
        [
            problem.states.ravel(),
            previous.ravel(),
            problem.goals.ravel(),
            problem.weights.ravel(),
            _by_stage(problem.obstacles[:, FIRST_FREE_STAGE:]),
            np.array([problem.safety_distances[pair] for pair in pairs]),
        ]
    )


def _bounds(problem: JointProblem, pairs: int) -> dict[str, Array]:
    """Bounds of variables and rows (eq. 9).

    Speed and area are widened where even full braking could not keep them, so that a limits-respecting
    solution always exists.
    """
    robots, steps = len(problem.states), problem.steps
    rows = pairs * (steps + 1 - FIRST_FREE_STAGE)
    braked = problem.rollout(braking_inputs(problem))[:, 1:]
    highest = np.full((robots, steps, 4), np.inf)
    highest[:, :, :2] = _widened(problem.area[1], braked[:, :, :2])
    highest[:, :, 3] = _widened(problem.speed_bounds[:, None], np.abs(braked[:, :, 3]))
    lowest = -highest
    lowest[:, :, :2] = -_widened(-problem.area[0], -braked[:, :, :2])
    inputs = np.tile(problem.input_bounds.ravel(), steps)
    first = slice(0, 2 * robots)
    least, most = -inputs, inputs.copy()
    least[first] = np.maximum(least[first], problem.first_inputs[:, 0].ravel())
    most[first] = np.minimum(most[first], problem.first_inputs[:, 1].ravel())
    rates = np.tile(problem.rate_bounds.ravel(), steps)
    dynamics, free = np.zeros(4 * robots * steps), np.full(rows, np.inf)
    return {
        "lbx": np.concatenate([_by_stage(lowest), least, np.zeros(rows)]),
        "ubx": np.concatenate([_by_stage(highest), most, free]),
        "lbg": np.concatenate([dynamics, -rates, np.zeros(rows)]),
        "ubg": np.concatenate([dynamics, rates, free]),
    }


def _widened(bound: Array, reached: Array) -> Array:
    """The bound, or as far beyond it as braking reaches, and then some room more, without a jump."""
    excess = np.maximum(reached - bound, 0.0)
    return bound + excess + np.minimum(excess, ROOM)


def _by_stage(values: Array) -> Array:
    """From (robot, stage, component) to the flat order of the variables: stage, robot, component."""
    return values.transpose(1, 0, 2).ravel()
