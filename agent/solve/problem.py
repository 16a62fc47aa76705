"""The joint trajectory problem, its solution and the interface of what solves it.

Prediction (eq. 7) and planning (eq. 1) are one problem: M robots whose inputs are free, and O obstacles with
known paths. Prediction frees all robots; planning frees the ego and lets the others move as predicted.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from agent.solve.compiled import kernel
from agent.solve.vehicle import Array, rollout
from protocol.scene import Scene
from protocol.vehicle import Input, Limits, braking_input

FIRST_FREE_STAGE = 2
"""Positions up to stage 1 are settled by the present state, so distances matter from here on."""

LIMITED_QUANTITIES = 5
"""A vehicle's limits a stage: turn rate, acceleration, the changes of both, and speed."""

PRICE = 4.0
"""Of a violated metre, in what a metre is worth to the robot furthest from its goal, over the whole horizon.
Above one it exceeds the multipliers of single rows, so that distances are kept exactly wherever they can be;
several rows share a robot's way. It is not far above: what a wrong prediction took is not won back at any
cost."""


@dataclass(frozen=True)
class JointProblem:
    """min Σ_i Σ_k (x_k − L)ᵀ Q_k (x_k − L) over the inputs of M robots, within limits and safety distances.

    Distances are kept by an exact L1 penalty: where they can be kept they are, and where they cannot (a
    prediction was wrong by a millimetre) the problem still has a solution.
    """

    states: Array
    """Present states, shape (M, 4): m, m, rad, m/s."""
    previous_inputs: Array
    """Inputs of the last step, shape (M, 2): rad/s, m/s²."""
    first_inputs: Array
    """The lowest and the highest input of the first step, shape (M, 2, 2), within what can be reached;
    infinite where nothing else bounds it."""
    goals: Array
    """Goal states L, shape (M, 4), each heading within half a turn of the present one."""
    limits: tuple[Limits, ...]
    """Of each of the M robots."""
    obstacles: Array
    """Positions of obstacles at the present and the next K stages, shape (O, K + 1, 2)."""
    safety_distances: Array
    """d of eq. 10 between each robot and each robot, then each obstacle, shape (M, M + O)."""
    sides: Array
    """On which side each robot is to pass each robot, then each obstacle, shape (M, M + O): the way from the
    one to the other turns anticlockwise for 1.0 and clockwise for −1.0; 0.0 leaves it open."""
    area: Array
    """Lower and upper corner of the drivable rectangle, shape (2, 2)."""
    weights: Array
    """Diagonal of Q at each stage, shape (K + 1, 4)."""
    steps: int
    """K, the prediction horizon."""
    step_s: float
    """Δt in s."""

    @cached_property
    def input_bounds(self) -> Array:
        """Largest |ω| and |a|, shape (M, 2)."""
        return np.array([(each.turn_rate_radps, each.acceleration_mps2) for each in self.limits])

    @cached_property
    def rate_bounds(self) -> Array:
        """Largest change of ω and a in a step, shape (M, 2)."""
        rates = np.array([(each.turn_acceleration_radps2, each.jerk_mps3) for each in self.limits])
        return rates * self.step_s

    @cached_property
    def speed_bounds(self) -> Array:
        """Largest |v|, shape (M,)."""
        return np.array([each.speed_mps for each in self.limits])

    @cached_property
    def size_m(self) -> float:
        """The largest safety distance of two of these robots: the length by which others are measured."""
        return float(np.diagonal(self.safety_distances).max())

    @cached_property
    def price_per_m(self) -> float:
        """Of a violated metre of distance, agreed side or area: ``PRICE`` times 2 K q (‖p − L‖ + d).

        q is the weight of positions, on average over stages 1 to K.
        """
        way_m = np.linalg.norm(self.states[:, :2] - self.goals[:, :2], axis=1).max() + self.size_m
        return float(PRICE * 2.0 * self.weights[1:, :2].max(axis=1).sum() * way_m)

    def rollout(self, inputs: Array) -> Array:
        """States (M, K + 1, 4) that follow from inputs (M, K, 2)."""
        return rollout(self.states, inputs, self.step_s)

    def objective(self, states: Array) -> float:
        """Sum of the stage and terminal costs (eq. 11) of states of shape (M, K + 1, 4)."""
        return float(np.sum(self.weights * (states - self.goals[:, None]) ** 2))

    def violation_m(self, states: Array) -> float:
        """Largest shortfall of a distance, or of the agreed side, that inputs could still influence."""
        positions = states[:, :, :2]
        everybody = np.concatenate([positions, self.obstacles])
        ways = positions[:, None] - everybody[None]
        gaps, distances = np.linalg.norm(ways, axis=-1), self.safety_distances[:, :, None]
        sight = ways[:, :, :1] / np.maximum(gaps[:, :, :1, None], 1e-300)
        along = np.abs((ways * sight).sum(axis=-1))
        across = self.sides[:, :, None] * (sight[..., 0] * ways[..., 1] - sight[..., 1] * ways[..., 0])
        beside = np.sqrt(np.maximum(distances**2 - along**2, 0.0))
        is_agreed = (self.sides[:, :, None] != 0.0) & (gaps[:, :, :1] > 0.0)
        wrong = is_agreed & ((across < 0.0) | (gaps < distances))
        turned = np.where(along < distances, (along**2 + beside * across) / distances, along)
        shortfall = (distances - np.where(wrong, turned, gaps))[:, :, FIRST_FREE_STAGE:]
        count = len(positions)
        shortfall[np.arange(count), np.arange(count)] = 0.0
        return float(max(shortfall.max(initial=0.0), 0.0))


def joint_problem(
    scene: Scene,
    states: Mapping[str, Array],
    goals: Mapping[str, Array],
    paths: Mapping[str, Array],
    inputs: Mapping[str, Input],
    cautions_m: Mapping[str, float] = {},
    sides: Mapping[tuple[str, str], float] = {},
) -> JointProblem:
    """The problem of the robots with goal states (4,), among others on known paths (K + 1, 2).

    Args:
        scene: limits, distances, weights, horizons.
        states: present ones, shape (4,), at least of the robots with goals.
        goals: of the robots that are free to move.
        paths: of the others.
        inputs: the last ones of the free robots.
        cautions_m: how much more than the safety distance to keep from some of the others.
        sides: on which side pairs are to pass one another, where that is agreed.
    """
    steps = scene.horizons.prediction_steps
    robots = list(goals)
    distances_m = np.array(scene.safety_distances_m(robots, (*robots, *paths)))
    distances_m[:, len(robots) :] += [cautions_m.get(robot, 0.0) for robot in paths]
    return JointProblem(
        states=np.array([states[robot] for robot in robots]),
        previous_inputs=np.array([inputs[robot] for robot in robots]),
        first_inputs=np.tile([[[-np.inf], [np.inf]]], (len(robots), 1, 2)),
        goals=np.array(list(goals.values())),
        limits=tuple(scene.robot(robot).limits for robot in robots),
        obstacles=np.array(list(paths.values())).reshape(-1, steps + 1, 2),
        safety_distances=distances_m,
        sides=np.array([[sides.get((one, other), 0.0) for other in (*robots, *paths)] for one in robots]),
        area=np.array([[scene.area.x_min_m, scene.area.y_min_m], [scene.area.x_max_m, scene.area.y_max_m]]),
        weights=np.tile(scene.weights.as_tuple(), (steps + 1, 1)),
        steps=steps,
        step_s=scene.step_s,
    )


@dataclass(frozen=True)
class Start:
    """Where a solver starts."""

    inputs: Array
    """Shape (M, K, 2)."""
    forces: Array
    """Constraint forces to expect, as those of a :class:`Solution`; zero where nothing is known."""
    limit_multipliers: Array
    """The same for the multipliers of limits."""
    warm: bool
    """Whether it comes from the last step's solution, so that little is left to do."""


@dataclass(frozen=True)
class Solution:
    """Trajectories that obey the model and all limits of the vehicles, and how good they are."""

    inputs: Array
    """Shape (M, K, 2)."""
    states: Array
    """Shape (M, K + 1, 4), the rollout of the inputs."""
    forces: Array
    """How the rows of distances and area push each position, shape (M, K + 1, 2): Σ λ n over those rows, the
    negative gradient of what they add to the Lagrangian. In cost a metre."""
    limit_multipliers: Array
    """Multipliers of the limits (eq. 9) on ω_k, a_k, their changes from k − 1 to k, and v_{k+1}, shape
    (M, K, 5): positive at the upper limit, negative at the lower one; zero where the solver knows none."""
    objective: float
    violation_m: float
    solved: bool
    """Whether the solver found a (local) optimum; if not, the trajectories are not to be driven."""
    iterations: int

    def start(self, robots: slice = slice(None), *, warm: bool = True) -> Start:
        """Where to start on a problem of all, or some, of these robots."""
        return Start(self.inputs[robots], self.forces[robots], self.limit_multipliers[robots], warm)


class JointSolver(Protocol):
    """Solves joint problems. It may keep compiled problems, but no state that changes a result."""

    def solve(self, problem: JointProblem, start: Start) -> Solution:
        """Find a local optimum near a start; ``solved`` is False where none was found."""
        ...


def braking_inputs(problem: JointProblem) -> Array:
    """Every robot brakes as hard as its limits allow, then stands. Shape (M, K, 2)."""
    inputs = np.empty((len(problem.states), problem.steps, 2))
    for robot, limits in enumerate(problem.limits):
        previous, speed = Input(*problem.previous_inputs[robot]), float(problem.states[robot, 3])
        for k in range(problem.steps):
            previous = braking_input(limits, previous, speed, problem.step_s)
            speed += problem.step_s * previous.acceleration_mps2
            inputs[robot, k] = previous
    return inputs


def within_limits(problem: JointProblem, inputs: Array) -> Array:
    """Inputs brought inside the input and rate limits, stage by stage. Shape (M, K, 2)."""
    bounds, wanted = problem.input_bounds, np.ascontiguousarray(inputs, dtype=float)
    previous = np.clip(problem.previous_inputs, -bounds, bounds)
    first = np.ascontiguousarray(problem.first_inputs, dtype=float)
    return clip_stages(wanted, previous, bounds, problem.rate_bounds, first)


@kernel
def clip_stages(inputs: Array, previous: Array, bounds: Array, rates: Array, first: Array) -> Array:
    """As ``protocol.vehicle.reachable_inputs`` clips one stage, for all robots and stages."""
    result = np.empty_like(inputs)
    for robot in range(inputs.shape[0]):
        for c in range(2):
            held = previous[robot, c]
            for k in range(inputs.shape[1]):
                low = max(held - rates[robot, c], -bounds[robot, c])
                high = min(held + rates[robot, c], bounds[robot, c])
                if k == 0:
                    low, high = max(low, first[robot, 0, c]), min(high, first[robot, 1, c])
                wanted = inputs[robot, k, c]
                held = min(wanted, high) if wanted >= low else low  # what is no number becomes the lowest
                result[robot, k, c] = held
    return result
