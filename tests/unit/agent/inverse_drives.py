"""Observed drives for the tests of inverse optimal control: random ones and really optimal ones."""

from functools import cache

import casadi as ca
import numpy as np
from agent_helpers import SAFETY_M, STEP_S, WEIGHTS, euler

from agent.solve.vehicle import Array
from protocol.vehicle import Limits

STEPS = 15
"""K_E."""


def drive(random: np.random.Generator, start: tuple[float, ...], states: int) -> Array:
    """A smooth drive within all limits, with some of them met, shape (states, 4)."""
    changes = random.uniform(-1.0, 1.0, (states - 1, 2)).clip(-0.8, 0.8) / 0.8 * [0.05, 0.7]
    return euler(start, np.cumsum(changes, axis=0).clip([-1.57, -3.0], [1.57, 3.0]))


def passing(seed: int) -> dict[str, Array]:
    """Four robots that pass one another closely; c came late, d only just."""
    random = np.random.default_rng(seed)
    tracks = {
        "a": drive(random, (-3.0, 0.0, 0.2, 1.0), STEPS + 2),
        "b": drive(random, (-1.0, -2.0, 1.5, 1.0), STEPS + 2),
        "c": drive(random, (2.0, 1.0, 3.0, 0.5), STEPS + 2),
        "d": drive(random, (-3.0, -2.0, 0.5, 2.0), STEPS + 2),
    }
    return tracks | {"c": tracks["c"][-9:], "d": tracks["d"][-1:]}


def crossing(steps: int = STEPS + 1) -> dict[str, Array]:
    """Three robots that solve one joint problem over 30 steps; its first steps, shape (steps + 1, 4) each."""
    return {robot: track[: steps + 1].copy() for robot, track in zip("abc", _crossing(), strict=True)}


@cache
def _crossing() -> list[Array]:
    random = np.random.default_rng(1)
    starts = [(-3.0, 0.0, 0.1, 1.0), (0.0, -3.0, 1.5, 1.5), (3.0, 1.0, 3.1, 0.5)]
    goals = np.array([(4.0, 0.5, 0.0, 0.0), (0.5, 4.0, 1.5, 0.0), (-4.0, -0.5, 3.0, 0.0)])
    goals += random.uniform(-0.5, 0.5, (3, 4)) * [1, 1, 0.3, 0]
    return optimal_drives(starts, goals, steps=30, limits=Limits(), distance_m=SAFETY_M)


def optimal_drives(
    starts: list[tuple[float, ...]],
    goals: Array,
    *,
    steps: int,
    limits: Limits | None = None,
    distance_m: float = 0.0,
    weights: tuple[float, ...] = WEIGHTS,
) -> list[Array]:
    """The joint optimum of eq. 7 by IPOPT, for robots without an input so far; no limits unless given."""
    program = ca.Opti()
    states = [program.variable(4, steps + 1) for _ in starts]
    inputs = [program.variable(2, steps) for _ in starts]
    for x, u, start in zip(states, inputs, starts, strict=True):
        way = STEP_S * ca.vertcat(x[3, :] * ca.cos(x[2, :]), x[3, :] * ca.sin(x[2, :]))
        program.subject_to(x[:, 0] == start)
        program.subject_to(x[:2, 1:] == x[:2, :-1] + way[:, :-1])
        program.subject_to(x[2:, 1:] == x[2:, :-1] + STEP_S * u)
        program.set_initial(x, np.array(start)[:, None] * np.ones(steps + 1))
        program.set_initial(u[0, :], 0.2)
        if limits is not None:
            rates = ca.diff(ca.horzcat(ca.DM.zeros(2), u), 1, 1) / STEP_S
            _bound(program, x[3, :], limits.speed_mps)
            _bound(program, u[0, :], limits.turn_rate_radps)
            _bound(program, u[1, :], limits.acceleration_mps2)
            _bound(program, rates[0, :], limits.turn_acceleration_radps2)
            _bound(program, rates[1, :], limits.jerk_mps3)
    for i, one in enumerate(states):
        for other in states[:i] if distance_m else []:
            program.subject_to(ca.sum1((one[:2, 2:] - other[:2, 2:]) ** 2) >= distance_m**2)
    errors = [x - ca.DM(goal) for x, goal in zip(states, goals, strict=True)]
    program.minimize(sum(ca.sum2(ca.DM(weights).T @ error**2) for error in errors))
    program.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-10})
    solution = program.solve()
    return [euler(start, solution.value(u).T) for start, u in zip(starts, inputs, strict=True)]


def _bound(program: ca.Opti, value: ca.MX, bound: float) -> None:
    program.subject_to(program.bounded(-bound, value, bound))
