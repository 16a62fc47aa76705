"""A Kalman filter of all goals, with the joint problem (eq. 7) as the model of what is measured.

After Le Cleac'h, Schwager and Manchester (2021), "LUCIDGames: Online unscented inverse dynamic games for
adaptive trajectory prediction and planning". Its state are the positions L of all N goals, which walk at
random; what it measures is the present state of all robots, x̄_t = x_K(L) + noise: where the joint problem
would have brought them from the states of K_w steps ago. That is no linear function, so the filter is an
unscented one: 4N + 1 sigma points, the solution of the joint problem for each of them.

Different here: the game is this project's joint problem; only goals are unknown, not weights; K_w is more
than one, since turn rates change so little in a step that one step says next to nothing; and all sigma points
start from the solution for the mean and take a single step of the solver from there.

Of the same family: Menner, Berntorp and Di Cairano (2021), "A Kalman filter for online calibration of optimal
controllers", which calibrates the cost of one controller.
"""

from collections.abc import Sequence

import numpy as np

from agent.estimate.goals import first_guess, goals_at, inside, sigmas_of, way_m
from agent.estimate.window import Window, WindowStarts, problem_from, window_of
from agent.remember.memory import Memory
from agent.solve.problem import JointProblem, Solution, Start
from agent.solve.realtime.solver import respond
from agent.solve.vehicle import Array
from protocol.scene import Scene

SPREAD = 3.0
"""c: sigma points lie √c standard deviations away. 3 matches the fourth moments of a Gaussian."""


def sigma_points(mean: Array, covariance: Array) -> Array:
    """The mean (n,), then points to both sides of it along a root of the covariance, shape (2n + 1, n)."""
    away = np.linalg.cholesky(SPREAD * covariance).T
    return np.concatenate([mean[None], mean + away, mean - away])


def updated(points: Array, images: Array, observed: Array, variances: Array) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) once a measurement (m,) with independent errors (m,) is known.

    The sigma points (2n + 1, n) each predict the measurement that is their image (2n + 1, m).
    """
    weight = 0.5 / SPREAD
    away, seen = points[1:] - points[0], images[1:] - images[0]
    expected = images[0] + weight * seen.sum(axis=0)
    cross = weight * away.T @ seen
    innovation = weight * seen.T @ seen + np.diag(variances)
    gain = np.linalg.solve(innovation, cross.T).T
    covariance = weight * away.T @ away - gain @ cross.T
    return points[0] + gain @ (observed - expected), 0.5 * (covariance + covariance.T)


SIGMAS = np.array([0.012, 0.012, 0.2, 0.09])
"""σ of p_x, p_y, ψ and v, in parts of ``way_m``, rad and of top speed: how well the model brings a robot to
where it is. Looks back overlap, so that one wrong prediction counts several times: half of this was too
little."""
WALK = 0.012
"""Standard deviation of a goal's random walk in one step, in parts of ``way_m``."""
GUESSED = 0.5
"""That of the first guess."""
ROUNDS = 2
"""Iterations a step of the solution for the mean,"""
COLD_ROUNDS = 4
"""or so many where no last one is there to start from."""


class KalmanFilter:
    """Keeps one Gaussian over the positions of all goals."""

    goals_are_shared = False

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._robots: list[str] = []
        self._mean = np.zeros(0)
        """Shape (2N,), in m."""
        self._covariance = np.zeros((0, 0))
        self._starts = WindowStarts()

    def estimate(self, memory: Memory) -> dict[str, Array]:
        """See :class:`agent.estimate.goals.GoalEstimator`."""
        self._keep_to(memory)
        self._covariance += np.diag(self._variances(WALK))
        window = window_of(memory, self._robots, self._scene)
        if window:
            self._measure(window)
        means = dict(zip(self._robots, self._mean.reshape(-1, 2), strict=True))
        return goals_at(self._scene, memory, means)

    def _keep_to(self, memory: Memory) -> None:
        """Let go of robots that went; of those that came, goals straight ahead are expected at first."""
        robots, last = memory.robots, self._robots
        if robots == last:
            return
        old = [robot for robot in robots if robot in last]
        mean = np.array([first_guess(self._scene, memory, robot) for robot in robots])
        self._robots = robots
        covariance = np.diag(self._variances(GUESSED))
        here, there = _places(robots, old), _places(last, old)
        mean.reshape(-1)[here] = self._mean[there]
        covariance[np.ix_(here, here)] = self._covariance[np.ix_(there, there)]
        self._mean, self._covariance = mean.ravel(), covariance

    def _variances(self, part: float) -> Array:
        """Of the positions of all goals, shape (2N,), for a part of each robot's ``way_m``."""
        ways = [way_m(self._scene.robot(robot).limits) for robot in self._robots]
        return np.repeat(np.square(part * np.array(ways)), 2)

    def _measure(self, window: Window) -> None:
        """Update by where robots are at the end of a window.

        Where the joint problem is not solved for every sigma point, nothing was measured.
        """
        points = sigma_points(self._mean, self._covariance)
        start = self._starts.start(self._problem(window, points[0]), window)
        for _ in range(ROUNDS if start.warm else COLD_ROUNDS):
            central = self._improved(window, points[0], start)
            start = central.start()
            if not central.solved:
                break
        solutions = [central]
        for point in points[1:]:
            if not solutions[-1].solved:
                break
            solutions.append(self._improved(window, point, start))
        if not solutions[-1].solved:
            self._starts.keep(window, solutions[-1])  # which is not solved, so the next one starts cold
            return
        images = np.array([each.states[:, window.states.shape[1]].ravel() for each in solutions])
        variances = sigmas_of(self._scene, self._robots, SIGMAS).ravel() ** 2
        mean, self._covariance = updated(points, images, window.states[:, -1].ravel(), variances)
        self._mean = np.array([inside(self._scene.area, goal) for goal in mean.reshape(-1, 2)]).ravel()
        self._starts.keep(window, central)

    def _problem(self, window: Window, goals: Array) -> JointProblem:
        return problem_from(self._scene, window, goals.reshape(-1, 2))

    def _improved(self, window: Window, goals: Array, start: Start) -> Solution:
        """The joint problem's solution for goals (2N,), a single step of the solver nearer."""
        return respond(self._problem(window, goals), start, 0).solution


def _places(robots: Sequence[str], chosen: Sequence[str]) -> list[int]:
    """Where the goals (x, y) of the chosen robots stand in the state."""
    return [2 * robots.index(robot) + axis for robot in chosen for axis in range(2)]
