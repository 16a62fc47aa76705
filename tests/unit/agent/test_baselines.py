"""The baselines: others predicted alone, and reciprocal collision avoidance by a differential drive."""

import math

import numpy as np
import pytest
import typer
from agent_helpers import (
    NEVER,
    SAFETY_M,
    SOLVERS,
    STEP_S,
    Watched,
    agent_of,
    euler,
    free,
    remembered,
    scene_of,
    seen,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from test_agent_closed_loop import run
from test_prediction_and_planning import advance, assert_begins_with

from agent.estimate import GoalsName
from agent.methods import method_of
from agent.process import options
from agent.remember.perception import REACQUIRED_AFTER
from agent.solve.orca import HORIZON_S, LEAN_RAD, PREFERRED_SPEED_MPS, OrcaPlanner, tracking_input
from agent.solve.planning import Planner
from agent.solve.prediction import Prediction
from protocol.scenario import Pose, Scenario, ScenarioRobot
from protocol.scene import Goal
from protocol.vehicle import STANDSTILL, Limits

ALONE: tuple[GoalsName, ...] = ("constant-acceleration-alone", "constant-velocity")
BASELINES: tuple[GoalsName, ...] = (*ALONE, "orca")
GOAL = Goal(x_m=4.0, y_m=0.0, heading_rad=0.0)
EGO = (-4.0, 0.0, 0.0, 1.0)
STRAIGHT = (0.0, 0.0)
COLLISION_M = 0.99


def predicted(goals: GoalsName, other: tuple[float, ...], driven: tuple[float, float]) -> Prediction:
    """What the ego predicts of another robot that begins in this state and is seen for two steps."""
    memory = remembered({"a": euler(EGO, [STRAIGHT]), "b": euler(other, [driven])})
    method = method_of(goals, scene_of("ab"), "a", SOLVERS["realtime"], NEVER)
    assert method.estimator.estimate(memory) == {}
    return method.predictor.predict(memory, {}, ())


@pytest.mark.parametrize("goals", ["constant-velocity", "orca"])
def test_at_constant_velocity_a_robot_goes_on_along_its_heading_however_it_turned(goals):
    path = predicted(goals, (1.0, 2.0, 0.5, -1.2), (0.3, 1.0)).paths["b"]
    start = euler((1.0, 2.0, 0.5, -1.2), [(0.3, 1.0)])[-1]
    way = STEP_S * start[3] * np.arange(31)
    np.testing.assert_allclose(path[:, 0], start[0] + way * math.cos(0.53), atol=1e-12)
    np.testing.assert_allclose(path[:, 1], start[1] + way * math.sin(0.53), atol=1e-12)


@pytest.mark.parametrize("goals", ALONE)
def test_the_others_are_predicted_alone_and_the_ego_plans_around_them_to_its_true_goal(goals):
    """The others meet head-on, and nobody makes way for anybody."""
    others = {"b": (0.0, -3.0, math.pi / 2, 1.0), "c": (0.0, 3.0, -math.pi / 2, 1.0)}
    decision = agent_of(GOAL, scene_of("abc"), goals=goals).decide(seen(0, {"a": EGO} | others))
    assert decision is not None
    mind = decision.mind
    assert (mind.estimates, list(mind.prediction), mind.failed) == ({}, ["b", "c"], ())
    between = np.linalg.norm(np.subtract(mind.prediction["b"], mind.prediction["c"]), axis=1)
    assert between.min() < COLLISION_M
    for path in mind.prediction.values():
        assert np.linalg.norm(np.subtract(mind.plan, path), axis=1).min() > SAFETY_M - 1e-3
    assert mind.plan[-1][0] > -1.4, "as far as two robots in its way let it"


def test_without_a_self_prediction_a_plan_starts_from_the_last_one_a_step_on_if_there_is_one():
    scene, solver = scene_of("ab"), Watched()
    memory = remembered({"a": np.array([EGO]), "b": np.array([(0.0, 0.3, math.pi, 0.5)])})
    _, predictor, planner, _ = method_of("constant-velocity", scene, "a", solver, NEVER)
    goal, plans, begun = np.array([4.0, 0.0, 0.0, 0.0]), [], []
    for _ in range(2):
        begun.append(len(solver.asked))
        prediction = predictor.predict(memory, {}, ())
        plans.append(planner.plan(memory, goal, STANDSTILL, prediction, free))
        advance(memory, {"a": plans[-1].inputs, "b": np.zeros((1, 2))})
    (alone, _), (_, cold) = solver.asked[:2]
    assert len(alone.obstacles) == 0
    assert_begins_with(cold, solver.answered[0].inputs)
    problem, warm = solver.asked[begun[1] + 1]
    np.testing.assert_array_equal(problem.goals, [goal])
    np.testing.assert_array_equal(problem.obstacles, [prediction.paths["b"]])
    np.testing.assert_array_equal(problem.sides, [[0.0, -1.0]])
    assert warm.warm
    np.testing.assert_array_equal(warm.inputs[0], [*plans[0].inputs[1:], STRAIGHT])
    for solver.fails in ({"plan"}, set()):
        asked = len(solver.asked)
        planner.plan(memory, goal, STANDSTILL, predictor.predict(memory, {}, ()), free)
    assert not next(start for problem, start in solver.asked[asked:] if len(problem.obstacles)).warm


poses = st.tuples(*[st.floats(-3.0, 3.0)] * 3, st.floats(-2.0, 2.0))


@settings(max_examples=20)
@given(st.lists(poses, max_size=15), st.sampled_from([0.4, 4.5]))
def test_orca_s_velocity_is_that_of_the_library_s_own_defaults_in_the_world_s_frame(states, top_speed):
    """Set up by defaults and setters instead, for an ego at the origin; also where robots coincide."""
    from pyrvo import RVOSimulator

    robots = "abcdefghijklmnop"
    tracks = dict(zip(robots, np.array([(0.0, 0.0, 0.7, 1.0), *states])[:, None], strict=False))
    memory = remembered(tracks)
    simulator = RVOSimulator(STEP_S, 1e3, 15, HORIZON_S, HORIZON_S, 0.695, top_speed)
    for index, ((x, y, heading, speed),) in enumerate(tracks.values()):
        simulator.add_agent((x, y))
        simulator.set_agent_velocity(index, (speed * math.cos(heading), speed * math.sin(heading)))
    direction = math.atan2(-3.0, 4.0) + LEAN_RAD
    preferred = min(PREFERRED_SPEED_MPS, top_speed) * np.array([math.cos(direction), math.sin(direction)])
    simulator.set_agent_pref_velocity(0, tuple(preferred.tolist()))
    simulator.do_step()
    scene = scene_of("ab", limits=Limits(speed_mps=top_speed))
    planner = OrcaPlanner(scene, "a", Planner(scene, "a", SOLVERS["realtime"], NEVER))
    velocity = planner.velocity(memory, np.array([4.0, -3.0, 0.0, 0.0]))
    assert np.isfinite(velocity).all()
    np.testing.assert_allclose(velocity, simulator.get_agent_velocity(0).to_tuple(), atol=1e-6)


@settings(max_examples=20)
@given(st.floats(-3.0, 3.0), st.floats(-2.0, 2.0), st.floats(-3.0, 3.0), st.floats(0.1, 4.0))
def test_a_velocity_is_reached_within_the_limits_and_without_turning_too_far(heading, speed, direction, size):
    limits, previous, state = Limits(), STANDSTILL, np.array([0.0, 0.0, heading, speed])
    wanted = size * np.array([math.cos(direction), math.sin(direction)])
    offset = math.remainder(direction - heading, math.tau)
    for _ in range(80):
        control = tracking_input(wanted, state, limits, previous, STEP_S)
        assert abs(control.turn_rate_radps) <= 1.57
        assert abs(control.acceleration_mps2) <= 3.0
        assert abs(control.turn_rate_radps - previous.turn_rate_radps) <= 0.05 + 1e-9
        assert abs(control.acceleration_mps2 - previous.acceleration_mps2) <= 0.7 + 1e-9
        state, previous = euler(state, [control])[-1], control
        turned = (state[2] - heading) * math.copysign(1.0, offset)
        assert -1e-6 <= turned <= abs(offset) + 1e-6
    assert turned == pytest.approx(abs(offset), abs=1e-6)
    assert state[3] == pytest.approx(size, abs=1e-3)


def test_orca_plans_one_step():
    decision = agent_of(GOAL, scene_of("ab"), goals="orca").decide(
        seen(0, {"a": EGO, "b": (0.0, 0.0, math.pi, 1.0)})
    )
    assert decision is not None
    moved = euler(EGO, [decision.command.input])
    np.testing.assert_allclose(decision.mind.plan, moved[:, :2])
    assert list(decision.mind.prediction) == ["b"]


def test_once_parking_a_robot_goes_on_parking_by_plans():
    ego = agent_of(GOAL, scene_of("ab"), goals="orca")
    near, pushed = (3.0, 0.3, 0.2, 0.5), (2.0, 0.5, 0.3, 0.5)
    lengths = [
        len(ego.decide(seen(step, {"a": at})).mind.plan)
        for step, at in enumerate((EGO, *[near] * REACQUIRED_AFTER, *[pushed] * REACQUIRED_AFTER))
    ]
    assert lengths[::REACQUIRED_AFTER] == [2, 31, 31]


def test_without_its_library_orca_is_refused_with_what_to_do(monkeypatch):
    monkeypatch.setattr("agent.process.options.is_available", lambda: False)
    assert options.checked_goals("constant-velocity") == "constant-velocity"
    with pytest.raises(typer.BadParameter, match=r"pyrvo.*not installed.*\.\[orca\]"):
        options.checked_goals("orca")


@pytest.mark.parametrize(
    ("goals", "ways"),
    [
        *((goals, [(-3.0, 1.0, 3.0, -2.0)]) for goals in ALONE),
        ("orca", [(-4.0, 0.0, 4.0, 0.0), (4.0, 0.0, -4.0, 0.0)]),
        ("orca", [(-4.0, 0.0, 4.0, 0.0), (4.0, 0.0, -4.0, 0.0), (0.0, -4.0, 0.0, 4.0)]),
    ],
)
def test_robots_park_and_by_orca_avoid_one_another(goals, ways):
    robots = [
        ScenarioRobot(id=str(i), start=Pose(x_m=x, y_m=y), goal=Pose(x_m=to_x, y_m=to_y))
        for i, (x, y, to_x, to_y) in enumerate(ways)
    ]
    truth, minds = run(Scenario(name="ways", robots=robots), goals, steps=300)
    assert truth.verdict == "arrived"
    assert len(ways) == 1 or truth.minimum_distance_m > COLLISION_M
    assert not any(mind.failed for mind in minds)
    assert all(robot.clipped_commands == 0 for robot in truth.robots.values())
