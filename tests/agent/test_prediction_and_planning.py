"""Prediction (eq. 7) and planning (eq. 1) around a solver that is watched, and with the reference solver."""

import math

import numpy as np
import pytest
from agent_helpers import SAFETY_M, STEP_S, euler, remembered, scene_of

from agent.memory import Memory
from agent.planning import Planner, plan_of
from agent.prediction import Predictor
from agent.problems import WarmStarts, joint_problem
from agent.solver.problem import JointProblem, Solution
from agent.solver.reference import ReferenceSolver
from agent.solver.starts import cold_start
from protocol.scene import Area, PublicRobot, Scene, Weights
from protocol.vehicle import STANDSTILL, Input, Limits

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


class Watched:
    """Solves as the reference does, and keeps what it was asked."""

    def __init__(self) -> None:
        self._solver = ReferenceSolver()
        self.asked: list[tuple[JointProblem, np.ndarray]] = []
        self.solved = True

    def solve(self, problem: JointProblem, guess: np.ndarray) -> Solution:
        self.asked.append((problem, guess))
        solution = self._solver.solve(problem, guess)
        return Solution(**(vars(solution) | {"solved": solution.solved and self.solved}))


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
    free = {robot: GOALS[robot] for robot in "ab"}
    problem = joint_problem(scene, memory_of("abc"), free, {"c": path}, previous)
    np.testing.assert_allclose(problem.states, [STATES["a"], STATES["b"]], atol=1e-12)
    np.testing.assert_array_equal(problem.goals, [GOALS["a"], GOALS["b"]])
    np.testing.assert_array_equal(problem.previous_inputs, [[0.1, 0.2], [0.3, 0.4]])
    np.testing.assert_array_equal(problem.obstacles, [path])
    np.testing.assert_array_equal(problem.area, [[-5.0, -7.0], [6.0, 8.0]])
    np.testing.assert_array_equal(problem.weights, [2.0, 3.0, 0.1, 0.2])
    between_radii = [[0.495 + 0.495, 0.495 + 0.3, 0.495 + 1.0], [0.3 + 0.495, 0.3 + 0.3, 0.3 + 1.0]]
    np.testing.assert_allclose(problem.safety_distances, np.array(between_radii) + 0.2)
    assert problem.limits == (strong, weak)
    assert (problem.steps, problem.step_s) == (12, 0.1)


def test_everybody_is_predicted_jointly_and_keeps_the_distances():
    prediction = Predictor(scene_of("abc"), ReferenceSolver()).predict(memory_of("abc"), GOALS, ())
    assert prediction.solved
    assert list(prediction.paths) == list(prediction.inputs) == list(prediction.states) == ["a", "b", "c"]
    for robot in "abc":
        driven = euler(STATES[robot], prediction.inputs[robot])
        np.testing.assert_allclose(prediction.states[robot], driven, atol=1e-9)
        np.testing.assert_array_equal(prediction.paths[robot], prediction.states[robot][:, :2])
    for one, other in ("ab", "bc", "ca"):
        gaps = np.linalg.norm(prediction.paths[one] - prediction.paths[other], axis=1)
        assert gaps.min() > SAFETY_M - 1e-6


def test_parked_robots_stay_and_are_avoided():
    memory = remembered({"a": np.array([STATES["a"]]), "b": np.array([(0.0, 0.1, 0.3, 0.02)])})
    solver = Watched()
    prediction = Predictor(scene_of("ab"), solver).predict(memory, {"a": GOALS["a"]}, {"b"})
    np.testing.assert_array_equal(prediction.paths["b"], np.tile([0.0, 0.1], (31, 1)))
    assert list(prediction.inputs) == list(prediction.states) == ["a"]
    assert solver.asked[0][0].states.shape == (1, 4)
    gaps = np.linalg.norm(prediction.paths["a"] - prediction.paths["b"], axis=1)
    assert gaps.min() == pytest.approx(SAFETY_M, abs=1e-6)


def test_the_first_prediction_starts_cold_and_each_further_one_from_the_last_a_step_on():
    solver, memory = Watched(), memory_of("ab")
    predictor = Predictor(scene_of("ab"), solver)
    first = predictor.predict(memory, GOALS, ())
    advance(memory, first.inputs)
    predictor.predict(memory, GOALS, ())
    (problem, cold), (_, warm) = solver.asked
    np.testing.assert_array_equal(cold, cold_start(problem))
    for row, robot in enumerate("ab"):
        np.testing.assert_array_equal(warm[row], [*first.inputs[robot][1:], (0.0, 0.0)])


def test_after_a_failed_prediction_the_next_one_starts_cold():
    solver, memory = Watched(), memory_of("ab")
    predictor = Predictor(scene_of("ab"), solver)
    predictor.predict(memory, GOALS, ())
    solver.solved = False
    failed = predictor.predict(memory, GOALS, ())
    assert not failed.solved
    solver.solved = True
    predictor.predict(memory, GOALS, ())
    problem, start = solver.asked[-1]
    np.testing.assert_array_equal(start, cold_start(problem))


def test_robots_that_appear_start_cold_and_those_that_stay_start_warm():
    problem = joint_problem(scene_of("abc"), memory_of("abc"), GOALS, {}, dict.fromkeys("abc", STANDSTILL))
    starts = WarmStarts()
    known = np.arange(120.0).reshape(2, 30, 2)
    starts.keep(["a", "c"], known)
    start = starts.start(problem, ["a", "b", "c"])
    np.testing.assert_array_equal(start[0, :-1], known[0, 1:])
    np.testing.assert_array_equal(start[1], cold_start(problem)[1])
    np.testing.assert_array_equal(start[2, :-1], known[1, 1:])
    starts.forget()
    np.testing.assert_array_equal(starts.start(problem, ["a", "b", "c"]), cold_start(problem))


def test_a_plan_leads_to_the_goal_it_was_given_among_the_predicted_paths():
    """The others are predicted with the estimated goals; the ego turns off to its true one."""
    scene, memory, solver = scene_of("abc"), memory_of("abc"), Watched()
    prediction = Predictor(scene, ReferenceSolver()).predict(memory, GOALS, ())
    true_goal = np.array([0.0, 3.5, 1.0, 0.0])
    plan = Planner(scene, "a", solver).plan(memory, true_goal, STANDSTILL, prediction)
    problem, start = solver.asked[0]
    assert plan.solved
    np.testing.assert_array_equal(problem.goals, [true_goal])
    np.testing.assert_array_equal(problem.obstacles, [prediction.paths["b"], prediction.paths["c"]])
    np.testing.assert_array_equal(start, prediction.inputs["a"][None])
    estimated, true = (np.linalg.norm(plan.states[-1, :2] - goal[:2]) for goal in (GOALS["a"], true_goal))
    assert true < estimated
    for robot in "bc":
        gaps = np.linalg.norm(plan.states[:, :2] - prediction.paths[robot], axis=1)
        assert gaps[2:].min() > SAFETY_M - 1e-6


def test_planning_for_the_estimated_goal_repeats_the_self_prediction():
    scene, memory = scene_of("abc"), memory_of("abc")
    prediction = Predictor(scene, ReferenceSolver()).predict(memory, GOALS, ())
    planner = Planner(scene, "b", ReferenceSolver())
    plan = planner.plan(memory, GOALS["b"], memory.previous_input("b"), prediction)
    np.testing.assert_allclose(plan.states[:, :2], prediction.paths["b"], atol=0.01)


def test_with_exchanged_goals_the_prediction_is_the_plan():
    prediction = Predictor(scene_of("ab"), ReferenceSolver()).predict(memory_of("ab"), GOALS, ())
    plan = plan_of(prediction, "b")
    assert plan.solved
    np.testing.assert_array_equal(plan.inputs, prediction.inputs["b"])
    np.testing.assert_array_equal(plan.states, prediction.states["b"])
