"""Estimators that begin 8 m ahead: what they find out about goals, and that nothing throws any of them.

``test_joint_fit`` and ``test_unscented`` have their arithmetic.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from agent_helpers import SOLVERS, STEP_S, problem_of, remembered, scene_of
from goal_helpers import drive, errors_m, followed
from scipy.optimize import least_squares

import agent.estimate.bilevel as bilevel
import agent.estimate.joint_fit as joint_fit
import agent.estimate.kalman_filter as kalman_filter
from agent.estimate.bilevel import Bilevel, ForwardProblem, fitted
from agent.estimate.inverse_optimal_control import InverseOptimalControl
from agent.estimate.joint_fit import JointFit
from agent.estimate.kalman_filter import KalmanFilter
from agent.estimate.window import AHEAD_M, WindowStarts, window_of
from agent.remember.memory import Memory
from agent.solve.multistart import cold_starts
from agent.solve.vehicle import Array
from protocol.scene import Horizons

ESTIMATORS = pytest.mark.parametrize("estimator_of", [KalmanFilter, Bilevel, JointFit])
TURNING = problem_of([(-3.0, -2.0, 0.0, 0.0)], [(1.5, 2.0, 0.8, 0.0)])
"""A robot whose goal is neither straight ahead nor 8 m away."""
CROSSING = problem_of(
    [(-3.0, 0.2, 0.0, 0.0), (0.1, -3.0, np.pi / 2, 0.0)], [(3.0, 0.5, 0.0, 0.0), (0.0, 2.5, np.pi / 2, 0.0)]
)


@pytest.fixture(scope="module")
def by_the_reference() -> tuple[Array, Array]:
    """A drive planned by IPOPT instead of by the solver that the estimators use."""
    return drive(CROSSING, 27, SOLVERS["reference"])


@pytest.mark.parametrize(("estimator_of", "near_m"), [(KalmanFilter, 0.3), (Bilevel, 0.2)])
def test_goals_are_found_from_a_drive_of_the_reference_solver(estimator_of, near_m, by_the_reference):
    states, goals = by_the_reference
    errors = errors_m(estimator_of(scene_of("01")), states, goals)
    assert errors[-1].max() < near_m
    assert errors[0].max() > 2.0, "it was not known before"


@pytest.mark.parametrize(
    ("estimator_of", "robots", "seeds"), [(KalmanFilter, 3, 2), (Bilevel, 3, 2), (JointFit, 4, 5)]
)
def test_goals_are_found_from_how_robots_drive_better_than_by_the_published_estimator(
    estimator_of, robots, seeds
):
    scene, found, published = scene_of("0123"[:robots]), [], []
    for seed in range(seeds):
        states, goals = followed(robots, seed, 25 if robots == 3 else 40)
        found.append(errors_m(estimator_of(scene), states, goals)[15:])
        published.append(errors_m(InverseOptimalControl(scene), states, goals)[15:])
    assert np.mean(found) < 0.7 * np.mean(published)
    assert estimator_of is not JointFit or np.median(np.array(found)[:, 10:]) < 0.5


def test_the_upper_level_finds_the_least_squares_solution():
    """Against scipy, with IPOPT on the lower level and differences for derivatives."""
    (states, _), length = drive(TURNING, 20), 12
    memory, scene = remembered({"0": states[:20, 0]}), scene_of("0")
    forward, last = ForwardProblem(scene, memory, window_of(memory, ["0"], scene)), np.array([2.0, 1.0])

    def residuals(goal: Any) -> Any:
        problem = forward.of(goal)
        path = SOLVERS["reference"].solve(problem, cold_starts(problem)[0]).states[0, 1 : length + 1]
        missing = (states[8:20, 0] - path) / bilevel.SIGMAS
        return np.concatenate([missing.ravel(), (goal - last) / bilevel.PULL_M])

    expected = least_squares(residuals, last, diff_step=1e-3, xtol=1e-4).x
    start = WindowStarts().start(forward.of(last), forward.window)
    found, solution = fitted(forward, last, start, scene.area)
    assert solution.solved
    assert np.linalg.norm(found - expected) < 0.05
    assert np.linalg.norm(found - last) > 0.5, "there was something to find"


@pytest.mark.parametrize(("estimator_of", "near_m"), [(KalmanFilter, 1.0), (Bilevel, 1.0), (JointFit, 0.7)])
def test_a_robot_that_stands_is_soon_taken_to_have_arrived(estimator_of, near_m):
    memory, estimator = Memory(17, STEP_S), estimator_of(scene_of("ab"))
    for step in range(40):
        memory.remember(step, {"a": (0.0, 0.0, 0.5, 0.0), "b": (4.0, 4.0, 2.0, 0.0)})
        goals = estimator.estimate(memory)
    assert np.linalg.norm(goals["a"][:2]) < near_m
    assert np.linalg.norm(goals["b"][:2] - 4.0) < near_m


@ESTIMATORS
def test_a_robot_that_appears_is_first_taken_to_go_straight_on_and_one_that_vanishes_is_forgotten(
    estimator_of,
):
    estimator = estimator_of(scene_of("ab"))
    far = {"a": np.array([(-4.0, 0.0, 0.0, 1.0)])}
    first = estimator.estimate(remembered(far))
    np.testing.assert_allclose(first["a"], [-4.0 + AHEAD_M, 0.0, 0.0, 0.0])
    both = remembered(
        {"a": np.array([(-4.0, 0.0, 0.0, 1.0), (-3.9, 0.0, 0.0, 1.0)]), "b": np.array([(0.0, 9.0, 1.5, 0.0)])}
    )
    found = estimator.estimate(both)
    assert set(found) == {"a", "b"}
    assert found["b"][1] == 10.0, "its goal is kept inside the area"
    assert set(estimator.estimate(remembered(far))) == {"a"}


@pytest.mark.parametrize(("estimator_of", "steps"), [(KalmanFilter, 40), (Bilevel, 40), (JointFit, 45)])
def test_robots_that_come_and_go_shorten_and_lengthen_the_window_and_do_no_harm(estimator_of, steps):
    """The others' goals are found all the same, although a passer-by is seen every now and then."""
    states, goals = followed(2, 1, steps)
    estimator, memory = estimator_of(scene_of("01p")), Memory(17, STEP_S)
    for step, now in enumerate(states):
        seen = {str(robot): tuple(state) for robot, state in enumerate(now.tolist())}
        if step % 20 < 4:
            seen["p"] = (8.0, -9.0 + 0.1 * step, np.pi / 2, 1.0)
        memory.remember(step, seen)
        found = estimator.estimate(memory)
        assert set(found) == set(memory.robots)
        assert all(np.isfinite(goal).all() for goal in found.values())
    errors = [np.linalg.norm(found[str(robot)][:2] - goal) for robot, goal in enumerate(goals)]
    assert max(errors) < 1.0


@ESTIMATORS
@pytest.mark.parametrize("prediction_steps", [2, 3, 60])
def test_horizons_may_be_of_any_length(estimator_of, prediction_steps):
    states, goals = followed(2, 0, 15)
    scene = scene_of("01", horizons=Horizons(prediction_steps=prediction_steps))
    assert np.isfinite(errors_m(estimator_of(scene), states, goals)).all()


@ESTIMATORS
def test_states_that_no_vehicle_drives_through_change_nothing_but_the_estimates(estimator_of):
    """Robots in one place, outside the area, faster than allowed, jumping: goals stay numbers in the area."""
    random = np.random.default_rng(3)
    scene, memory = scene_of("abc"), Memory(17, STEP_S)
    estimator, area = estimator_of(scene), scene.area
    for step in range(0, 12, 2):
        wild = random.normal(size=4) * [12.0, 12.0, 4.0, 6.0]
        memory.remember(step, {"a": tuple(wild), "b": tuple(wild), "c": (0.0, 0.0, 0.0, 0.0)})
        for x, y, heading, speed in estimator.estimate(memory).values():
            assert area.x_min_m <= x <= area.x_max_m
            assert area.y_min_m <= y <= area.y_max_m
            assert np.isfinite(heading)
            assert speed == 0.0


@ESTIMATORS
def test_all_robots_that_see_the_same_think_the_same(estimator_of):
    states, goals = followed(2, 2, 16)
    one, other = (errors_m(estimator_of(scene_of("01")), states, goals) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def unsolved(respond: Callable[..., Any]) -> Callable[..., Any]:
    def failing(*given: Any) -> Any:
        response = respond(*given)
        return replace(response, solution=replace(response.solution, solved=False))

    return failing


@pytest.mark.parametrize(
    ("estimator_of", "module"), [(KalmanFilter, kalman_filter), (Bilevel, bilevel), (JointFit, joint_fit)]
)
def test_where_a_problem_is_not_solved_the_last_estimates_stay(estimator_of, module, monkeypatch):
    states, _ = followed(2, 1, 24)
    estimator, memory, found = estimator_of(scene_of("01")), Memory(17, STEP_S), []
    for step, now in enumerate(states):
        memory.remember(step, {str(robot): tuple(state) for robot, state in enumerate(now.tolist())})
        with monkeypatch.context() as patch:
            if step == 20:
                patch.setattr(module, "respond", unsolved(module.respond))
            estimates = estimator.estimate(memory)
        found.append(np.array([goal[:2] for goal in estimates.values()]))
    np.testing.assert_array_equal(found[20], found[19])
    assert (found[23] != found[20]).any(), "it goes on afterwards"


def test_other_robots_move_as_seen_and_before_and_after_that_straight_on():
    """For a robot that was seen for twelve steps; the other one for the last four of them only."""
    states, _ = followed(2, 1, 20)
    memory, scene = remembered({"a": states[:, 0], "b": states[-5:, 1]}), scene_of("ab")
    forward = ForwardProblem(scene, memory, window_of(memory, ["a"], scene))
    path = forward.of(np.zeros(2)).obstacles[0]
    np.testing.assert_allclose(path[8:13], states[-5:, 1, :2])
    for end, steps, place in ((-1, 18, path[-1]), (-5, -8, path[0])):
        x, y, heading, speed = states[end, 1]
        way_m = steps * STEP_S * speed
        np.testing.assert_allclose(place, [x + way_m * np.cos(heading), y + way_m * np.sin(heading)])
