"""Prediction (eq. 7) and planning (eq. 1) around a solver that is watched, and with both solvers."""

import math
from itertools import combinations

import numpy as np
import pytest
from agent_helpers import NEVER, SAFETY_M, SOLVERS, STEP_S, Watched, euler, remembered, scene_of

from agent.remember.memory import Memory
from agent.solve.multistart import WarmStarts, cold_starts
from agent.solve.planning import Planner
from agent.solve.prediction import RETRY_STEPS, Predictor
from agent.solve.problem import JointSolver, Start, joint_problem
from protocol.scene import Area, PublicRobot, Scene, Weights
from protocol.vehicle import STANDSTILL, Input, Limits

TOLERANCE_M = 1e-4
"""Of distances where a solver has converged, as from a cold start."""
STATES = {
    "a": (-4.0, 0.0, 0.0, 1.0),
    "b": (4.0, 0.2, math.pi, 1.0),
    "c": (0.0, -4.0, math.pi / 2, 0.5),
}
GOALS = {
    "a": np.array([4.0, 0.0, 0.0, 0.0]),
    "b": np.array([-4.0, 0.2, math.pi, 0.0]),
    "c": np.array([0.0, 4.0, math.pi / 2, 0.0]),
}


@pytest.fixture(params=SOLVERS)
def solver(request: pytest.FixtureRequest) -> JointSolver:
    return SOLVERS[request.param]


def assert_same_starts(found: list[Start], expected: list[Start]) -> None:
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.inputs, other.inputs)
        np.testing.assert_array_equal(one.forces, other.forces)
        assert one.warm == other.warm


def memory_of(robots: str, steps: int = 2) -> Memory:
    """Robots that have driven straight at a constant speed."""
    tracks = {}
    for robot in robots:
        x, y, heading, speed = STATES[robot]
        back = speed * STEP_S * (steps - 1)
        start = (x - back * math.cos(heading), y - back * math.sin(heading), heading, speed)
        tracks[robot] = euler(start, np.zeros((steps - 1, 2)))
    return remembered(tracks)


def advance(memory: Memory, inputs: dict[str, np.ndarray]) -> None:
    """Everybody drives the first of its inputs."""
    moved = {robot: euler(memory.state(robot), inputs[robot][:1])[-1] for robot in memory.robots}
    memory.remember(memory.step + 1, moved)


def test_the_joint_problem_holds_what_the_scene_and_the_memory_say():
    strong, weak = Limits(), Limits(speed_mps=1.0, acceleration_mps2=0.5)
    scene = Scene(
        robots={
            "a": PublicRobot(limits=strong),
            "b": PublicRobot(radius_m=0.3, limits=weak),
            "c": PublicRobot(radius_m=1.0),
        },
        area=Area(x_min_m=-5.0, x_max_m=6.0, y_min_m=-7.0, y_max_m=8.0),
        weights=Weights(x=2.0, y=3.0, heading=0.1, speed=0.2),
        horizons={"prediction_steps": 12, "estimation_steps": 5},
        safety_margin_m=0.1,
    )
    path = np.arange(26.0).reshape(13, 2)
    previous = {"a": Input(0.1, 0.2), "b": Input(0.3, 0.4)}
    free, cautions = {robot: GOALS[robot] for robot in "ab"}, {"c": 0.3, "b": 9.9}
    problem = joint_problem(scene, memory_of("abc").present(), free, {"c": path}, previous, cautions)
    np.testing.assert_allclose(problem.states, [STATES["a"], STATES["b"]], atol=1e-12)
    np.testing.assert_array_equal(problem.goals, [GOALS["a"], GOALS["b"]])
    np.testing.assert_array_equal(problem.previous_inputs, [[0.1, 0.2], [0.3, 0.4]])
    np.testing.assert_array_equal(problem.obstacles, [path])
    np.testing.assert_array_equal(problem.area, [[-5.0, -7.0], [6.0, 8.0]])
    np.testing.assert_array_equal(problem.weights, [2.0, 3.0, 0.1, 0.2])
    between_radii = [[0.495 + 0.495, 0.495 + 0.3, 0.495 + 1.0], [0.3 + 0.495, 0.3 + 0.3, 0.3 + 1.0]]
    caution_m = [0.0, 0.0, 0.3]  # from those only who are not planned for
    np.testing.assert_allclose(problem.safety_distances, np.array(between_radii) + 0.2 + caution_m)
    assert problem.limits == (strong, weak)
    assert (problem.steps, problem.step_s) == (12, 0.1)


def test_everybody_is_predicted_jointly_and_keeps_the_distances(solver):
    prediction = Predictor(scene_of("abc"), solver, NEVER).predict(memory_of("abc"), GOALS, ())
    assert prediction.solved
    for each in (prediction.paths, prediction.inputs, prediction.starts, prediction.states):
        assert list(each) == ["a", "b", "c"]
    for robot in "abc":
        driven = euler(STATES[robot], prediction.inputs[robot])
        np.testing.assert_allclose(prediction.states[robot], driven, atol=1e-9)
        np.testing.assert_array_equal(prediction.paths[robot], prediction.states[robot][:, :2])
    for one, other in ("ab", "bc", "ca"):
        gaps = np.linalg.norm(prediction.paths[one] - prediction.paths[other], axis=1)
        assert gaps.min() > SAFETY_M - TOLERANCE_M


def test_parked_robots_stay_and_are_avoided():
    memory = remembered({"a": np.array([STATES["a"]]), "b": np.array([(0.0, 0.1, 0.3, 0.02)])})
    solver = Watched()
    prediction = Predictor(scene_of("ab"), solver, NEVER).predict(memory, {"a": GOALS["a"]}, {"b"})
    np.testing.assert_array_equal(prediction.paths["b"], np.tile([0.0, 0.1], (31, 1)))
    assert list(prediction.inputs) == list(prediction.states) == ["a"]
    assert solver.asked[0][0].states.shape == (1, 4)
    gaps = np.linalg.norm(prediction.paths["a"] - prediction.paths["b"], axis=1)
    assert gaps.min() == pytest.approx(SAFETY_M, abs=TOLERANCE_M)


def test_parked_robots_stand_in_one_order_however_they_are_named():
    memory = memory_of("abc")
    orders = [["b", "c"], ["c", "b"]]
    paths = [
        Predictor(scene_of("abc"), SOLVERS["realtime"], NEVER).predict(memory, GOALS, order).paths
        for order in orders
    ]
    assert [list(each) for each in paths] == [["a", "b", "c"]] * 2
    np.testing.assert_array_equal(paths[0]["a"], paths[1]["a"])


def test_the_first_prediction_and_that_after_a_failed_one_start_cold_the_others_from_the_last_a_step_on():
    solver, memory = Watched(), memory_of("ab")
    predictor = Predictor(scene_of("ab"), solver, NEVER)
    first = predictor.predict(memory, GOALS, ())
    advance(memory, first.inputs)
    predictor.predict(memory, GOALS, ())
    *tried, (_, warm) = solver.asked
    assert_same_starts([start for _, start in tried], cold_starts(tried[0][0]))
    assert warm.warm
    for row, robot in enumerate("ab"):
        np.testing.assert_array_equal(warm.inputs[row], [*first.inputs[robot][1:], (0.0, 0.0)])
        np.testing.assert_array_equal(warm.forces[row], [*first.starts[robot].forces[0, 1:], (0.0, 0.0)])
        limit_multipliers = first.starts[robot].limit_multipliers[0]
        np.testing.assert_array_equal(warm.limit_multipliers[row], [*limit_multipliers[1:], np.zeros(5)])
    for solver.fails, solved in (({"predict"}, False), (set(), True)):
        solver.asked.clear()
        assert predictor.predict(memory, GOALS, ()).solved == solved
    assert_same_starts([start for _, start in solver.asked], cold_starts(solver.asked[0][0]))


def test_robots_that_appear_start_cold_and_those_that_stay_start_warm():
    memory = memory_of("abc")
    problem = joint_problem(scene_of("abc"), memory.present(), GOALS, {}, dict.fromkeys("abc", STANDSTILL))
    solution = SOLVERS["realtime"].solve(problem, cold_starts(problem)[0])
    starts = WarmStarts()
    starts.keep(["a", "c", "gone"], solution)
    colds = cold_starts(problem)
    found = starts.starts(problem, ["a", "b", "c"])
    for start, unknown in zip(found, colds, strict=True):
        for row, kept in ((0, 0), (2, 1)):
            np.testing.assert_array_equal(start.inputs[row, :-1], solution.inputs[kept, 1:])
            np.testing.assert_array_equal(start.forces[row, :-1], solution.forces[kept, 1:])
            np.testing.assert_array_equal(
                start.limit_multipliers[row, :-1], solution.limit_multipliers[kept, 1:]
            )
        np.testing.assert_array_equal(start.inputs[1], unknown.inputs[1])
        assert not start.forces[1].any()
        assert not start.limit_multipliers[1].any()
        assert not start.warm
    starts.forget()
    assert_same_starts(starts.starts(problem, ["a", "b", "c"]), colds)


def test_a_plan_leads_to_the_goal_it_was_given_among_the_predicted_paths():
    """The others are predicted with the estimated goals; the ego turns off to its true one."""
    scene, memory, solver = scene_of("abc"), memory_of("abc"), Watched("reference")
    prediction = Predictor(scene, SOLVERS["realtime"], NEVER).predict(memory, GOALS, ())
    true_goal = np.array([0.0, 3.5, 1.0, 0.0])
    plan = Planner(scene, "a", solver, NEVER).plan(memory, true_goal, STANDSTILL, prediction)
    problem, start = solver.asked[0]
    assert plan.solved
    np.testing.assert_array_equal(problem.goals, [true_goal])
    np.testing.assert_array_equal(problem.obstacles, [prediction.paths["b"], prediction.paths["c"]])
    assert start.warm
    np.testing.assert_array_equal(start.inputs, prediction.inputs["a"][None])
    assert start is prediction.starts["a"]
    assert start.forces.any()
    assert start.limit_multipliers.any()
    estimated, true = (np.linalg.norm(plan.states[-1, :2] - goal[:2]) for goal in (GOALS["a"], true_goal))
    assert true < estimated
    for robot in "bc":
        gaps = np.linalg.norm(plan.states[:, :2] - prediction.paths[robot], axis=1)
        assert gaps[2:].min() > SAFETY_M - TOLERANCE_M


def test_planning_for_the_estimated_goal_repeats_the_self_prediction(solver):
    scene, memory = scene_of("abc"), memory_of("abc")
    prediction = Predictor(scene, solver, NEVER).predict(memory, GOALS, ())
    planner = Planner(scene, "b", solver, NEVER)
    plan = planner.plan(memory, GOALS["b"], memory.previous_input("b"), prediction)
    np.testing.assert_allclose(plan.states[:, :2], prediction.paths["b"], atol=0.01)


@pytest.mark.parametrize(("how", "others"), [({}, False), ({"sigmas": (0.02, 0.02, 0.03, 0.05)}, True)])
def test_where_robots_may_see_differently_predictions_are_also_sought_from_cold_starts(how, others):
    """All of them in turn, by everybody at the same steps; from the last prediction always."""
    memory, solver = Memory(17, STEP_S), Watched()
    predictor = Predictor(scene_of("abc"), solver, NEVER)
    states = {robot: np.array(STATES[robot]) for robot in "abc"}
    cold: list[list[float]] = []
    for step in range(1 + 4 * RETRY_STEPS):
        memory.remember(step, states, **how)
        asked = len(solver.asked)
        prediction = predictor.predict(memory, GOALS, ())
        states = {robot: euler(states[robot], prediction.inputs[robot][:1])[-1] for robot in "abc"}
        if step > 0:
            first, *more = [start for _, start in solver.asked[asked:]]
            assert first.warm
            assert len(more) == (others and step % RETRY_STEPS == 0)
            cold += [start.inputs[:, -1, 0].tolist() for start in more]
    assert len(cold) == (4 if others else 0)
    assert all(one != other for one, other in combinations(cold, 2))
