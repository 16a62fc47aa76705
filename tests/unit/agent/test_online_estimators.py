"""Estimators that begin straight ahead: what they find out about goals, their arithmetic, their manners."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from agent_helpers import SOLVERS, STEP_S, cold, enlarged, problem_of, remembered, scene_of, square
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from realtime_helpers import closed_loop, random_crossing, recorded_programs
from scipy.optimize import least_squares

import agent.estimate.bilevel as bilevel
import agent.estimate.joint_fit as joint_fit
import agent.estimate.kalman_filter as kalman_filter
from agent.estimate.bilevel import Bilevel, ForwardProblem, fitted
from agent.estimate.goals import GoalEstimator, first_guess, sigmas_of, way_m
from agent.estimate.inverse_optimal_control import InverseOptimalControl
from agent.estimate.joint_fit import JointFit, gauss_newton
from agent.estimate.kalman_filter import SPREAD, KalmanFilter, sigma_points, updated
from agent.estimate.window import WindowStarts, window_of
from agent.remember.memory import Memory
from agent.solve.problem import JointProblem, JointSolver
from agent.solve.realtime.kkt import Program
from agent.solve.realtime.profiles import pull_back
from agent.solve.realtime.qp import solve_program
from agent.solve.realtime.sequential import response
from agent.solve.vehicle import Array
from protocol.scene import Horizons, PublicRobot, Scene
from protocol.vehicle import Limits


@cache
def followed(robots: int, seed: int, steps: int) -> tuple[Array, Array]:
    """States (steps, N, 4) of robots that know each other's goals, and those goals (N, 2)."""
    return drive(random_crossing(robots, seed), steps)


def drive(
    problem: JointProblem, steps: int, solver: JointSolver = SOLVERS["realtime"]
) -> tuple[Array, Array]:
    """The same from any problem on."""
    loop = list(closed_loop(problem, steps, solver))
    return np.array([each.problem.states for each in loop]), problem.goals[:, :2]


def errors_m(estimator: GoalEstimator, states: Array, goals: Array) -> Array:
    """Distance of each robot's estimate from its goal after every step, shape (steps, N)."""
    memory, names = Memory(17, STEP_S), [str(robot) for robot in range(len(goals))]
    found = []
    for step, now in enumerate(states):
        memory.remember(step, dict(zip(names, map(tuple, now.tolist()), strict=True)))
        estimates = estimator.estimate(memory)
        found.append(
            [np.linalg.norm(estimates[name][:2] - goal) for name, goal in zip(names, goals, strict=True)]
        )
    return np.array(found)


ESTIMATORS = pytest.mark.parametrize("estimator_of", [KalmanFilter, Bilevel, JointFit])
TURNING = problem_of([(-3.0, -2.0, 0.0, 0.0)], [(1.5, 2.0, 0.8, 0.0)])
"""A robot whose goal is neither straight ahead nor where it is first taken to be."""
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
    ("estimator_of", "robots", "steps"), [(KalmanFilter, 3, 25), (Bilevel, 3, 25), (JointFit, 4, 35)]
)
def test_goals_are_found_from_how_robots_drive_better_than_by_the_published_estimator(
    estimator_of, robots, steps
):
    scene, found, published = scene_of("0123"[:robots]), [], []
    for seed in (0, 1):
        states, goals = followed(robots, seed, steps)
        found.append(errors_m(estimator_of(scene), states, goals)[15:])
        published.append(errors_m(InverseOptimalControl(scene), states, goals)[15:])
    assert np.median(found) < 0.7 * np.median(published)
    assert estimator_of is not JointFit or np.mean(found) < 0.7 * np.mean(published)


def test_the_upper_level_finds_the_least_squares_solution():
    """Against scipy, with IPOPT on the lower level and differences for derivatives."""
    (states, _), length = drive(TURNING, 20), 12
    memory, scene = remembered({"0": states[:20, 0]}), scene_of("0")
    forward, last = ForwardProblem(scene, memory, window_of(memory, ["0"], scene)), np.array([2.0, 1.0])

    sigmas, pull_m = sigmas_of(scene, "0", bilevel.SIGMAS)[0], bilevel.PULL * way_m(Limits())

    def residuals(goal: Any) -> Any:
        problem = forward.of(goal)
        path = SOLVERS["reference"].solve(problem, cold(problem)).states[0, 1 : length + 1]
        missing = (states[8:20, 0] - path) / sigmas
        return np.concatenate([missing.ravel(), (goal - last) / pull_m])

    expected = least_squares(residuals, last, diff_step=1e-3, xtol=1e-4).x
    start = WindowStarts().start(forward.of(last), forward.window)
    found = fitted(forward, last, start, scene.area)
    assert found.solution.solved
    assert np.linalg.norm(found.goal - expected) < 0.05
    assert np.linalg.norm(found.goal - last) > 0.5, "there was something to find"


@pytest.mark.parametrize(("estimator_of", "near_m"), [(KalmanFilter, 1.0), (Bilevel, 1.0), (JointFit, 0.7)])
def test_a_robot_that_stands_is_soon_taken_to_have_arrived(estimator_of, near_m):
    memory, estimator = Memory(17, STEP_S), estimator_of(scene_of("ab"))
    for step in range(25):
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
    np.testing.assert_allclose(first["a"], [-4.0 + way_m(Limits()), 0.0, 0.0, 0.0])
    both = remembered(
        {"a": np.array([(-4.0, 0.0, 0.0, 1.0), (-3.9, 0.0, 0.0, 1.0)]), "b": np.array([(0.0, 9.0, 1.5, 0.0)])}
    )
    found = estimator.estimate(both)
    assert set(found) == {"a", "b"}
    assert found["b"][1] == 10.0, "its goal is kept inside the area"
    assert set(estimator.estimate(remembered(far))) == {"a"}


@pytest.mark.parametrize("scale", [0.02, 1.0, 10.0])
def test_a_goal_is_first_guessed_where_top_speed_is_just_reached_but_not_on_somebody_elses_course(scale):
    """With top speed 2, braking at 1 and jerk 2: 4 m to speed up and stop, and 1 m to change between them."""
    limits = enlarged(scale, Limits(speed_mps=2.0, acceleration_mps2=1.0, jerk_mps3=2.0))
    robot = PublicRobot(limits=limits, radius_m=0.5 * scale)
    scene = Scene(robots={"a": robot, "b": robot}, area=square(20.0 * scale))

    for x_m, y_m, expected_m in (
        (5.0, 9.0, 5.0),  # b drives away
        (5.0, -9.0, 5.0),  # it does not come so far
        (5.9, -4.0, 2.0 * 3.0),  # a would stand in its way, so a goes on at full speed
        (6.1, -4.0, 5.0),  # the bodies would not touch
    ):
        states = np.array([[(0.0, 1.0, 0.0, 0.0)], [(x_m, y_m, np.pi / 2, 1.0)]]) * [scale, scale, 1.0, scale]
        found = first_guess(scene, remembered(dict(zip("ab", states, strict=True))), "a")
        np.testing.assert_allclose(found / scale, [expected_m, 1.0], rtol=1e-12)


def test_a_robot_that_brakes_is_believed_to_stop_near_although_no_derivative_leads_there():
    """It was thought to go on for the whole horizon, off the course of another one."""
    states = [(-9.0, 0.0, 0.0, 0.0), (-0.3, -8.0, np.pi / 2, 0.0)]
    seen, goals = drive(problem_of(states, [(1.0, 0.0, 0.0, 0.0), (-0.3, -4.0, np.pi / 2, 0.0)]), 30)
    errors = errors_m(JointFit(scene_of("01")), seen, goals)
    assert errors[18, 0] > 2.5
    assert errors[26:].max() < 0.2
    assert np.linalg.norm(seen[26, 0, :2] - goals[0]) > 2.5


@ESTIMATORS
def test_robots_that_come_and_go_shorten_and_lengthen_the_window_and_do_no_harm(estimator_of):
    """The others' goals are found all the same, although a passer-by is seen every now and then."""
    states, goals = followed(2, 1, 34)
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
@pytest.mark.parametrize("prediction_steps", [2, 3, 45])
def test_horizons_may_be_of_any_length(estimator_of, prediction_steps):
    states, goals = followed(2, 0, 6)
    scene = scene_of("01", horizons=Horizons(prediction_steps=prediction_steps))
    assert np.isfinite(errors_m(estimator_of(scene), states, goals)).all()


@ESTIMATORS
def test_states_that_no_vehicle_drives_through_change_nothing_but_the_estimates(estimator_of):
    """Robots in one place, outside the area, faster than allowed, jumping: goals stay numbers in the area."""
    random = np.random.default_rng(3)
    scene, memory = scene_of("abc"), Memory(17, STEP_S)
    estimator, area = estimator_of(scene), scene.area
    for step in range(0, 8, 2):
        wild = random.normal(size=4) * [12.0, 12.0, 4.0, 6.0]
        memory.remember(step, {"a": tuple(wild), "b": tuple(wild), "c": (0.0, 0.0, 0.0, 0.0)})
        for x, y, heading, speed in estimator.estimate(memory).values():
            assert area.x_min_m <= x <= area.x_max_m
            assert area.y_min_m <= y <= area.y_max_m
            assert np.isfinite(heading)
            assert speed == 0.0


def unsolved(respond: Callable[..., Any]) -> Callable[..., Any]:
    def failing(*given: Any) -> Any:
        response = respond(*given)
        return replace(response, solution=replace(response.solution, solved=False))

    return failing


@pytest.mark.parametrize(
    ("estimator_of", "module"), [(KalmanFilter, kalman_filter), (Bilevel, bilevel), (JointFit, joint_fit)]
)
def test_where_a_problem_is_not_solved_the_last_estimates_stay(estimator_of, module, monkeypatch):
    states, _ = followed(2, 1, 16)
    estimator, memory, found = estimator_of(scene_of("01")), Memory(17, STEP_S), []
    for step, now in enumerate(states):
        memory.remember(step, {str(robot): tuple(state) for robot, state in enumerate(now.tolist())})
        with monkeypatch.context() as patch:
            if step == 10:
                patch.setattr(module, "respond", unsolved(module.respond))
            estimates = estimator.estimate(memory)
        found.append(np.array([goal[:2] for goal in estimates.values()]))
    np.testing.assert_array_equal(found[10], found[9])
    assert (found[15] != found[10]).any(), "it goes on afterwards"


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


TIGHT = 1e-7


def solved(program: Program, gradients: Array) -> Array:
    limit_multipliers = np.zeros((2, *program.low.shape))
    outcome = solve_program(program._replace(gradients=gradients), limit_multipliers, TIGHT)
    assert outcome.solved
    return outcome.change


@pytest.mark.parametrize(("robots", "seed"), [(2, 0), (3, 1), (4, 2)])
def test_the_response_to_a_shifted_goal_is_that_of_finite_differences(robots, seed):
    errors = []
    for program in recorded_programs(random_crossing(robots, seed), range(4, 14, 3)):
        outcome = solve_program(program, np.zeros((2, *program.low.shape)), TIGHT)
        for goal in range(2 * robots):
            pull = np.zeros((program.gradients.shape[1] // 2 + 1, 2))
            pull[:, goal % 2] = -program.weights[:, goal % 2]
            change = np.zeros_like(program.gradients)
            pull_back(program.jacobian[goal // 2], pull, change[goal // 2])
            there, back = (solved(program, program.gradients + side * 1e-3 * change) for side in (1.0, -1.0))
            expected = (there - back) / 2e-3
            errors.append(
                np.abs(response(program, outcome, change) - expected).max() / np.abs(expected).max()
            )
    # Where a limit begins or ceases to be tight between the two, differences show half of each.
    assert np.median(errors) < 0.06
    assert np.mean(np.array(errors) < 0.1) > 0.75


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 6), st.sampled_from([1e-2, 10.0]))
def test_a_gauss_newton_step_solves_the_least_squares_problem(seed, robots, length, far):
    """Against numpy's least squares on the residuals written out; no goal moves further than it may."""
    random = np.random.default_rng(seed)
    by_goal = random.normal(size=(2 * robots, robots, length, 4))
    sigmas, longest_m = random.uniform(0.1, 2.0, (robots, 4)), random.uniform(0.5, 2.0, robots)
    missing = far * random.normal(size=(robots, length, 4)) * sigmas[:, None]
    root = random.normal(size=(2 * robots, 2 * robots)) + 4.0 * np.eye(2 * robots)
    prior = random.normal(size=(robots, 2))
    found, covariance = gauss_newton(prior, root.T @ root, by_goal, missing, sigmas, longest_m)
    rows = np.concatenate([(by_goal / sigmas[:, None]).reshape(2 * robots, -1).T, root])
    right = np.concatenate([(missing / sigmas[:, None]).ravel(), np.zeros(2 * robots)])
    expected = np.linalg.lstsq(rows, right, rcond=None)[0].reshape(-1, 2)
    expected *= np.minimum(1.0, longest_m / np.linalg.norm(expected, axis=1))[:, None]
    np.testing.assert_allclose(found - prior, expected, atol=1e-8)
    np.testing.assert_allclose(covariance, np.linalg.inv(rows.T @ rows), rtol=1e-6, atol=1e-9)


def test_the_window_holds_what_was_seen_and_the_inputs_that_lead_through_it():
    """Of as many steps as both were seen."""
    states, _ = followed(2, 3, 17)
    memory = remembered({"a": states[:, 0], "b": states[-9:, 1]})
    window = window_of(memory, ["a", "b"], scene_of("ab"))
    assert (window.robots, window.step, window.states.shape) == (["a", "b"], 8, (2, 8, 4))
    np.testing.assert_allclose(window.begin, [states[-9, 0], states[-9, 1]])
    np.testing.assert_allclose(window.states[0], states[-8:, 0])
    driven = (states[1:, 0, 2:] - states[:-1, 0, 2:]) / STEP_S
    np.testing.assert_allclose(window.inputs[0], driven[-8:], atol=1e-9)
    np.testing.assert_allclose(window.before[0], driven[-9], atol=1e-9)
    assert window.before[1] == (0.0, 0.0), "before it was seen"


seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 8)


def gaussian(random: np.random.Generator, size: int) -> tuple[Array, Array]:
    root = random.normal(size=(size, size)) + 2.0 * np.eye(size)
    return random.normal(size=size), root @ root.T


@settings(max_examples=15)
@given(seeds, sizes, sizes)
def test_of_a_bent_measurement_the_filter_is_that_of_filterpy(seed, size, measured):
    random = np.random.default_rng(seed)
    mean, covariance = gaussian(random, size)
    matrix = random.normal(size=(measured, size))

    def measure(state: Array) -> Array:
        return np.tanh(matrix @ state) + 0.1 * (matrix @ state) ** 2

    observed, variances = random.normal(size=measured), random.uniform(0.1, 2.0, measured)
    points = sigma_points(mean, covariance)
    found, left = updated(points, np.array([measure(point) for point in points]), observed, variances)
    library = UnscentedKalmanFilter(
        size,
        measured,
        dt=1.0,
        hx=measure,
        fx=lambda state, _: state,
        points=MerweScaledSigmaPoints(size, alpha=np.sqrt(SPREAD / size), beta=SPREAD / size, kappa=0.0),
    )
    library.x, library.P = mean, covariance
    library.sigmas_f = library.points_fn.sigma_points(mean, covariance)
    library.update(observed, R=np.diag(variances))
    np.testing.assert_allclose(found, library.x, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(left, library.P, rtol=1e-6, atol=1e-6)
    assert np.linalg.eigvalsh(left).min() > -1e-6 * np.linalg.eigvalsh(left).max()
