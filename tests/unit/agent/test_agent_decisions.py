"""One turn of algorithm 1: what is done in which order, with which goals, and what comes of it."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from agent_helpers import EPOCH, STEP_S, Watched, agent_of, euler, scene_of, seen

from agent.agent import Agent, Decision
from protocol.codec import decode, encode
from protocol.messages import Mind
from protocol.scene import Goal

A = (-4.0, 0.0, 0.0, 1.0)
B = (0.5, -4.0, math.pi / 2, 1.0)
AHEAD, LEFT = Goal(x_m=4.0, y_m=0.0, heading_rad=0.0), Goal(x_m=-3.0, y_m=4.0, heading_rad=math.pi / 2)
GOALS = {"a": AHEAD, "b": Goal(x_m=0.5, y_m=4.0, heading_rad=math.pi / 2)}


@pytest.fixture
def solver() -> Watched:
    return Watched()


def robot_a(goal: Goal = AHEAD, **how: Any) -> Agent:
    return agent_of(goal, scene_of("ab", goals=GOALS if how.get("goals") == "exchanged" else None), **how)


def decided(agent: Agent, step: int, states: Mapping[str, tuple[float, ...]]) -> Decision:
    decision = agent.decide(seen(step, states))
    assert decision is not None
    assert decision.command.epoch == decision.mind.epoch == EPOCH
    assert decision.command.robot == decision.mind.robot == "a"
    assert decision.command.step == decision.mind.step == step
    assert decode(Mind, encode(decision.mind)) == decision.mind
    return decision


def test_the_first_input_of_the_plan_is_commanded():
    decision = decided(robot_a(), 0, {"a": A, "b": B})
    states, plan = euler(A, [decision.command.input]), np.array(decision.mind.plan)
    assert plan[:2] == pytest.approx(states[:, :2], abs=1e-6)
    # The heading and the speed after the first step show in the position after two.
    turned, faster = states[1, 2:]
    then = states[1, :2] + STEP_S * faster * np.array([math.cos(turned), math.sin(turned)])
    assert plan[2] == pytest.approx(then, abs=1e-6)


def test_with_exchanged_goals_the_joint_prediction_is_the_plan(solver):
    mind = decided(robot_a(goals="exchanged", solver=solver), 0, {"a": A, "b": B}).mind
    assert solver.phases == ["predict"]
    assert mind.plan == mind.prediction["a"]
    assert (mind.estimates["a"].x_m, mind.estimates["b"].y_m) == (4.0, 4.0)


def test_it_predicts_itself_with_its_estimated_goal_and_plans_with_the_true_one(solver):
    """The others see a robot that drives straight ahead; only the ego knows that it will turn left.

    Whatever its true goal, it is thought of in the same way.
    """
    ahead, left = (decided(robot_a(goal), 0, {"a": A, "b": B}).mind for goal in (AHEAD, LEFT))
    assert (ahead.estimates, ahead.prediction) == (left.estimates, left.prediction)
    assert ahead.plan != left.plan
    mind = decided(robot_a(LEFT, solver=solver), 0, {"a": A, "b": (9.0, -9.0, 0.0, 0.0)}).mind
    predicting, planning = solver.asked[0][0], solver.asked[-1][0]
    estimate = mind.estimates["a"]
    assert (estimate.x_m, estimate.y_m) == pytest.approx(tuple(predicting.goals[0, :2]))
    assert estimate.x_m > 4.0
    assert estimate.y_m == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(planning.goals, [[-3.0, 4.0, math.pi / 2, 0.0]])
    predicted, planned = np.array(mind.prediction["a"]), np.array(mind.plan)
    np.testing.assert_allclose(predicted[:, 1], 0.0, atol=1e-4)
    assert planned[-1, 1] > 1.5
    np.testing.assert_allclose(planning.obstacles[0], mind.prediction["b"])


def test_the_goal_heading_is_approached_the_shorter_way_round(solver):
    goal = Goal(x_m=-9.0, y_m=0.0, heading_rad=-3.0)
    decided(robot_a(goal, solver=solver), 0, {"a": (-4.0, 0.0, 3.0, 1.0), "b": B})
    assert solver.asked[-1][0].goals[0, 2] == pytest.approx(math.tau - 3.0)


@pytest.mark.parametrize("failing", ["predict", "plan"])
def test_failures_are_counted_and_answered_by_the_rule(solver, failing):
    agent = robot_a(solver=solver)
    solver.fails = {failing}
    first = decided(agent, 0, {"a": A, "b": B})
    then = tuple(euler(A, [first.command.input])[-1])
    second = decided(agent, 1, {"a": then, "b": B})
    assert (first.mind.failed, first.mind.solver_failures) == ((failing,), 1)
    assert first.mind.degraded == ("solver failure",)
    assert (second.mind.failed, second.mind.solver_failures) == ((failing,), 2)
    assert first.command.input == pytest.approx((-0.05, -0.7))
    assert second.command.input == pytest.approx((-0.1, -1.4))
    assert bool(first.mind.plan) == (failing == "plan")
    assert ("plan" in solver.phases) == (failing == "plan"), "nothing to plan with"
    solver.fails = set()
    recovered = decided(agent, 2, {"a": A, "b": B})
    assert (recovered.mind.failed, recovered.mind.solver_failures) == ((), 2)
    assert "solver failure" not in recovered.mind.degraded


def test_repeated_old_and_blind_observations_are_not_answered():
    agent, twin = robot_a(), robot_a()
    for each in (agent, twin):
        decided(each, 3, {"a": A, "b": B})
    moved = {"a": tuple(euler(A, [(0.0, 0.5)])[1]), "b": B}
    for step, states in ((3, moved), (2, moved), (0, moved), (4, {"b": B}), (4, {})):
        assert agent.decide(seen(step, states)) is None
    assert agent.decide(seen(4, moved)) == twin.decide(seen(4, moved))


def test_agents_given_the_same_decide_the_same_whatever_their_clocks_say():
    def run(clock) -> list[tuple[bytes, object]]:
        agent = robot_a(LEFT, goals="ioc", clock=clock)
        state, decisions = A, []
        for step in range(18):
            decision = decided(agent, step, {"a": state, "b": (0.5, -4.0 + 0.1 * step, math.pi / 2, 1.0)})
            state = tuple(euler(state, [decision.command.input])[1])
            thought = decision.mind.model_dump(exclude={"timings_ms"})
            decisions.append((encode(decision.command), thought))
        return decisions

    readings = iter(np.arange(1e4) ** 1.5)
    assert run(lambda: 0.0) == run(lambda: float(next(readings)))
