"""The last-resort monitor in whole runs: what it prevents, and that those who agree do not need it."""

from typing import Any

import pytest
from faults_helpers import facts, fault, run, scenario

from agent.drive.safety import CollisionMonitor
from fleet.run.virtual import Step
from protocol.scenario import load_scenario
from scenarios import find

MEETING: list[dict[str, Any]] = [
    {"id": 1, "start": {"x_m": -5.3, "y_m": 0.0}, "goal": {"x_m": 8.0, "y_m": 0.0}},
    {"id": 2, "start": {"x_m": 2.9, "y_m": -3.7}, "goal": {"x_m": 2.9, "y_m": 8.0}},
]
"""They agree that robot 2 passes before robot 1."""


def stopping_in_the_way() -> list[Step]:
    """Robot 2 brakes for good where robot 1 relies on it to be gone."""
    stops = fault("stops", robots=["2"], start_s=0.9)
    return list(run(scenario(stops, robots=MEETING, time_limit_s=4.0), facts(goals="exchanged")))


def interventions(driven: list[Step]) -> dict[str, int]:
    counts = {}
    for step in driven:
        counts |= {robot: decision.mind.interventions for robot, decision in step.decisions.items()}
    return counts


def test_it_prevents_the_collision_with_a_robot_that_stops_in_the_way() -> None:
    driven = stopping_in_the_way()
    assert driven[-1].truth.collisions == ()
    assert interventions(driven)["1"] == 1


def test_switched_off_it_prevents_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CollisionMonitor, "must_brake", lambda *_: False)
    driven = stopping_in_the_way()
    assert driven[-1].truth.collisions == (("1", "2"),)
    assert interventions(driven)["1"] == 0


def test_robots_that_agree_pass_one_another_closely_without_it() -> None:
    crossing = load_scenario(find("4-crossing")).model_copy(update={"time_limit_s": 6.0})
    driven = list(run(crossing, facts(goals="exchanged")))
    least_m, collision_m = driven[-1].truth.minimum_distance_m, 2.0 * crossing.robots[0].radius_m
    assert least_m is not None
    assert collision_m < least_m < collision_m + 2.5 * crossing.safety_margin_m, "they do meet"
    assert set(interventions(driven).values()) == {0}
    assert not any(decision.mind.degraded for step in driven for decision in step.decisions.values())
