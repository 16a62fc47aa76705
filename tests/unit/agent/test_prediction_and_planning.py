"""Prediction (eq. 7) and planning (eq. 1) around a solver that is watched, and with both solvers."""

import math

import numpy as np
import pytest
from agent_helpers import NEVER, SAFETY_M, SOLVERS, STEP_S, Watched, cold, euler, free, remembered, scene_of

from agent.remember.memory import Memory
from agent.solve.arrival import EarlyPlanner
from agent.solve.planning import JointPlan, Planner
from agent.solve.prediction import Predictor
from agent.solve.problem import JointSolver, Start, joint_problem
from agent.solve.starts import WarmStarts, openings_of
from protocol.scene import Area, PublicRobot, Scene, Weights
from protocol.vehicle import STANDSTILL, Input, Limits, Reachable

TOLERANCE_M = 1e-4
"""Of distances where a solver has converged, as from a cold start."""
STATES = {"a": (-4.0, 0.0, 0.0, 1.0), "b": (4.0, 0.2, math.pi, 1.0), "c": (0.0, -4.0, math.pi / 2, 0.5)}
GOALS = {
    "a": np.array([4.0, 0.0, 0.0, 0.0]),
    "b": np.array([-4.0, 0.2, math.pi, 0.0]),
    "c": np.array([0.0, 4.0, math.pi / 2, 0.0]),
}


@pytest.fixture(params=SOLVERS)
def solver(request: pytest.FixtureRequest) -> JointSolver:
    return SOLVERS[request.param]


def assert_begins_with(start: Start, inputs: np.ndarray) -> None:
    """Of a start of which nothing else is known."""
    np.testing.assert_array_equal(start.inputs, inputs)
    assert not start.forces.any()
    assert not start.limit_multipliers.any()
    assert not start.warm


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
    sides = {("a", "b"): -1.0, ("b", "a"): -1.0, ("b", "c"): 1.0, ("c", "b"): 1.0}
    problem = joint_problem(scene, memory_of("abc").present(), free, {"c": path}, previous, cautions, sides)
    np.testing.assert_allclose(problem.states, [STATES["a"], STATES["b"]], atol=1e-12)
    np.testing.assert_array_equal(problem.goals, [GOALS["a"], GOALS["b"]])
    np.testing.assert_array_equal(problem.previous_inputs, [[0.1, 0.2], [0.3, 0.4]])
    np.testing.assert_array_equal(problem.obstacles, [path])
    np.testing.assert_array_equal(problem.area, [[-5.0, -7.0], [6.0, 8.0]])
    np.testing.assert_array_equal(problem.weights, [[2.0, 3.0, 0.1, 0.2]] * 13)
    between_radii = [[0.495 + 0.495, 0.495 + 0.3, 0.495 + 1.0], [0.3 + 0.495, 0.3 + 0.3, 0.3 + 1.0]]
    caution_m = [0.0, 0.0, 0.3]  # from those only who are not planned for
    np.testing.assert_allclose(problem.safety_distances, np.array(between_radii) + 0.2 + caution_m)
    np.testing.assert_array_equal(problem.sides, [[0.0, -1.0, 0.0], [-1.0, 0.0, 1.0]])
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
    assert all(problem.states.shape == (1, 4) for problem, _ in solver.asked)
    assert all(len(problem.obstacles) == 1 for problem, _ in solver.asked)
    gaps = np.linalg.norm(prediction.paths["a"] - prediction.paths["b"], axis=1)
    assert gaps.min() == pytest.approx(SAFETY_M, abs=TOLERANCE_M)


def test_parked_robots_stand_in_one_order_however_they_are_named():
    memory, predictors = memory_of("abc"), [Predictor(scene_of("abc"), Watched(), NEVER) for _ in range(2)]
    one, other = (
        each.predict(memory, GOALS, order).paths for each, order in zip(predictors, ("bc", "cb"), strict=True)
    )
    assert list(one) == list(other) == ["a", "b", "c"]
    np.testing.assert_array_equal(one["a"], other["a"])


def test_the_first_prediction_and_that_after_a_failed_one_have_several_openings_others_the_last_one():
    """One step on."""
    solver, memory = Watched(), memory_of("ab")
    predictor = Predictor(scene_of("ab"), solver, NEVER)
    first = predictor.predict(memory, GOALS, ())
    advance(memory, first.inputs)
    assert_opens(solver.asked)
    predictor.predict(memory, GOALS, ())
    warm = solver.asked[-1][1]
    assert warm.warm
    for row, robot in enumerate("ab"):
        np.testing.assert_array_equal(warm.inputs[row], [*first.inputs[robot][1:], (0.0, 0.0)])
        np.testing.assert_array_equal(warm.forces[row], [*first.starts[robot].forces[0, 1:], (0.0, 0.0)])
    for solver.fails, solved in (({"predict"}, False), (set(), True)):
        begin = len(solver.asked)
        assert predictor.predict(memory, GOALS, ()).solved == solved
    assert_opens(solver.asked[begin:])


def assert_opens(asked):
    """Every opening was tried, with nothing but a cold one in it."""
    openings = [opening() for opening in openings_of(asked[0][0])]
    assert len(asked) == len(openings)
    for (_, start), opening in zip(asked, openings, strict=True):
        assert not start.warm
        np.testing.assert_array_equal(start.inputs, opening.inputs)


def test_robots_that_appear_start_cold_and_those_that_stay_start_warm():
    memory = memory_of("abc")
    problem = joint_problem(scene_of("abc"), memory.present(), GOALS, {}, dict.fromkeys("abc", STANDSTILL))
    solution = SOLVERS["realtime"].solve(problem, cold(problem))
    starts = WarmStarts()
    starts.keep(["a", "c", "gone"], solution)
    start = starts.start(problem, ["a", "b", "c"], otherwise=lambda: cold(problem))
    for row, kept in ((0, 0), (2, 1)):
        np.testing.assert_array_equal(start.inputs[row, :-1], solution.inputs[kept, 1:])
        np.testing.assert_array_equal(start.forces[row, :-1], solution.forces[kept, 1:])
        np.testing.assert_array_equal(start.limit_multipliers[row, :-1], solution.limit_multipliers[kept, 1:])
    np.testing.assert_array_equal(start.inputs[1], cold(problem).inputs[1])
    assert not start.forces[1].any()
    assert not start.limit_multipliers[1].any()
    assert not start.warm


def test_a_plan_leads_to_the_goal_it_was_given_among_the_predicted_paths():
    """The others are predicted with the estimated goals; the ego turns off to its true one."""
    scene, memory, solver = scene_of("abc"), memory_of("abc"), Watched("reference")
    prediction = Predictor(scene, SOLVERS["realtime"], NEVER).predict(memory, GOALS, ())
    true_goal = np.array([0.0, 3.5, 1.0, 0.0])
    plan = Planner(scene, "a", solver, NEVER).plan(memory, true_goal, STANDSTILL, prediction, free)
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
    plan = planner.plan(memory, GOALS["b"], memory.previous_input("b"), prediction, free)
    np.testing.assert_allclose(plan.states[:, :2], prediction.paths["b"], atol=0.01)


@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("plans", [Planner, EarlyPlanner])
@pytest.mark.parametrize("narrowed", [(-0.03, -0.7, 0.01, -0.2), (0.02, 0.3, 0.02, 0.3)])
def test_a_plan_begins_within_the_room_that_it_is_left(plans, narrowed, joint):
    """And goes on as well as it can from there; a single input is room enough."""
    scene, memory = scene_of("abc"), memory_of("abc")
    prediction = Predictor(scene, SOLVERS["realtime"], NEVER).predict(memory, GOALS, ())
    planner = plans(scene, "a", SOLVERS["realtime"], NEVER)
    room = Reachable(Input(*narrowed[:2]), Input(*narrowed[2:]))
    asked = JointPlan("a", planner) if joint else planner
    plan, unbound = (
        each.plan(memory, GOALS["a"], STANDSTILL, prediction, allowed)
        for each, allowed in (
            (asked, lambda wanted: room),
            (plans(scene, "a", SOLVERS["realtime"], NEVER), free),
        )
    )
    assert plan.solved
    assert room.clip(Input(*plan.inputs[0])) == Input(*plan.inputs[0])
    assert room.clip(Input(*unbound.inputs[0])) != Input(*unbound.inputs[0])
    np.testing.assert_allclose(plan.states, euler(memory.state("a"), plan.inputs), atol=1e-9)
    assert plan.states[-1, 0] > 2.0, "it is on its way none the less"
