"""Reserve and last resort in whole runs: what they prevent, and how little those who agree need them."""

from typing import Any

import pytest
from faults_helpers import facts, fault, parsed, run, scenario

from agent.drive.reserve import Reserve
from fleet.run.virtual import Step
from protocol.scenario import load_scenario
from scenarios import find

MEETING: list[dict[str, Any]] = [
    {"id": 1, "start": {"x_m": -5.3, "y_m": 0.0}, "goal": {"x_m": 8.0, "y_m": 0.0}},
    {"id": 2, "start": {"x_m": 2.9, "y_m": -3.7}, "goal": {"x_m": 2.9, "y_m": 8.0}},
]
"""They agree that robot 2 passes before robot 1."""


def stopping_in_the_way(**how: Any) -> list[Step]:
    """Robot 2 brakes for good where robot 1 relies on it to be gone."""
    stops = fault("stops", robots=["2"], start_s=0.9)
    return list(run(scenario(stops, robots=MEETING, time_limit_s=4.0), facts(goals="exchanged", **how)))


def interventions(driven: list[Step]) -> dict[str, int]:
    counts = {}
    for step in driven:
        counts |= {robot: decision.mind.interventions for robot, decision in step.decisions.items()}
    return counts


def test_the_collision_with_a_robot_that_stops_in_the_way_is_prevented_by_the_reserve() -> None:
    """Who stops obeys: it brakes along its contingency, with which everybody reckons, also in its plans."""
    driven = stopping_in_the_way()
    assert driven[-1].truth.collisions == ()
    assert interventions(driven)["1"] == 0, "it plans within the reserve"
    without = stopping_in_the_way(reserve=False)
    assert without[-1].truth.collisions == (("1", "2"),)
    assert interventions(without)["1"] == 0


def test_robots_that_agree_pass_one_another_closely_and_are_hardly_held_back() -> None:
    crossing = load_scenario(find("4-crossing")).model_copy(update={"time_limit_s": 6.0})
    driven = list(run(crossing, facts(goals="exchanged")))
    least_m, collision_m = driven[-1].truth.minimum_distance_m, 2.0 * crossing.robots[0].radius_m
    assert least_m is not None
    assert collision_m < least_m < collision_m + 2.5 * crossing.safety_margin_m, "they do meet"
    assert max(interventions(driven).values()) <= 1
    held_back = [robot for step in driven for robot, each in step.decisions.items() if each.mind.degraded]
    assert len(held_back) <= 2 * len(crossing.robots), "for a step or two"


@pytest.mark.slow
@pytest.mark.parametrize("goals", ["joint-fit", "ioc", "exchanged"])
def test_nobody_is_held_back_where_eight_that_see_exactly_plan_within_the_reserve(goals: str) -> None:
    """They meet as closely as they may; without rooms for their plans they would be held back."""
    driven = list(run(load_scenario(find("8a")), facts(goals=goals)))
    truth = driven[-1].truth
    assert truth.verdict == "arrived"
    assert truth.minimum_distance_m is not None
    assert truth.minimum_distance_m < 1.45, "they do meet"
    assert len(interventions(driven)) == 8
    assert not any(interventions(driven).values())


def test_who_gives_no_way_where_its_line_asks_for_it_is_doubted_and_braked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    crossing = load_scenario(find("2-crossing"))
    faults = parsed(fault("ignores", robots=["1"]))
    ignoring = crossing.model_copy(update={"faults": faults, "time_limit_s": 4.0})
    doubts: list[list[str]] = []
    doubted = Reserve.doubted

    def noting(self: Reserve, memory: Any) -> list[str]:
        doubts.append(doubted(self, memory))
        return doubts[-1]

    monkeypatch.setattr(Reserve, "doubted", noting)
    driven = list(run(ignoring, facts()))
    assert ["1"] in doubts
    assert driven[-1].truth.collisions == ()
