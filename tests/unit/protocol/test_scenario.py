"""Scenarios: published defaults, checks of the whole, the public scene, and files written and read back."""

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from protocol.scenario import (
    Pose,
    Scenario,
    ScenarioRobot,
    Sensing,
    load_scenario,
    scenario_text,
)
from protocol.scene import Area, Horizons, Weights
from protocol.vehicle import Limits
from scenarios import find


def robot(name: str, start: tuple[float, float], goal: tuple[float, float], **more: Any) -> dict[str, Any]:
    return {
        "id": name,
        "start": {"x_m": start[0], "y_m": start[1]},
        "goal": {"x_m": goal[0], "y_m": goal[1]},
        **more,
    }


def scenario(*robots: dict[str, Any], **more: Any) -> Scenario:
    return Scenario.model_validate({"name": "test", "robots": list(robots), **more})


A = robot("a", (-4, 0), (4, 0))
B = robot("b", (0, -4), (0, 4))


@pytest.mark.parametrize(("goal", "heading"), [((-4, -4), -math.pi / 2), ((-8, 0), math.pi)])
def test_a_heading_left_out_points_from_start_to_goal(goal: tuple[float, float], heading: float) -> None:
    way = robot("a", (-4, 0), goal)
    (it,) = scenario(way).robots
    assert it.start_state() == pytest.approx((-4, 0, heading, 0))
    assert it.goal_pose().as_state() == pytest.approx((*goal, heading, 0))
    way["start"]["heading_rad"], way["goal"]["heading_rad"] = 1.0, -2.0
    (it,) = scenario(way).robots
    assert (it.start_state()[2], it.goal_pose().heading_rad) == (1.0, -2.0)


def test_the_scene_holds_no_start_and_a_goal_only_if_asked() -> None:
    published = scenario(A, B).scene(with_goals=False)
    assert published.collision_distance_m("a", "b") == pytest.approx(0.7 * math.sqrt(2), abs=1e-3)
    assert published.safety_distance_m("a", "b") == pytest.approx(0.7 * math.sqrt(2) + 0.4, abs=1e-3)
    it = scenario(A, {**B, "radius_m": 1}, weights={"speed": 0.5}, step_s=0.05, safety_margin_m=0.5)
    goals = it.scene(with_goals=True).goals
    assert goals is not None
    assert goals["a"].as_state() == (4, 0, 0, 0)
    scene = it.scene(with_goals=False)
    assert scene.collision_distance_m("a", "b") == pytest.approx(1.495)
    assert scene.safety_distance_m("a", "b") == pytest.approx(2.495)
    assert scene.goals is None
    assert set(scene.model_dump()) == {
        "step_s", "area", "horizons", "weights", "arrival_tolerance", "safety_margin_m", "robots", "goals",
    }  # fmt: skip
    assert all(set(public) == {"radius_m", "limits"} for public in scene.model_dump()["robots"].values())
    assert (scene.weights.speed, scene.step_s, list(scene.robots)) == (0.5, 0.05, ["a", "b"])


@pytest.mark.parametrize(
    ("robots", "place", "words"),
    [
        ([robot("a", (-10.01, 0), (4, 0))], "robots.0.start", " lies outside the area x -10…10, y -10…10 m"),
        ([A, B, robot("a", (3, 3), (-3, -3))], "robots.2.id", "the id 'a' is used twice; ids must differ"),
        ([A, robot("b", (-4, 0.985), (4, 5))], "robots.1.start", "0.99 m are needed: their bodies"),
        ([A, robot("b", (-4, 5), (4, 1.385))], "robots.1.goal", "1.39 m are needed: they could not"),
        ([A, B, robot("c", (0, 4), (0, -5), radius_m=5.5)], "robots.2.start", "'a' and 'c' are "),
    ],
)
def test_robots_need_room_inside_the_area_and_ids_of_their_own(
    robots: list[dict[str, Any]], place: str, words: str
) -> None:
    with pytest.raises(ValidationError) as raised:
        scenario(*robots)
    (error,) = raised.value.errors()
    assert error["ctx"]["where"] == place
    assert words in error["ctx"]["what"]
    scenario(robot("a", (-10, -10), (10, 10)), robot("b", (-9.005, -10), (8.605, 10)))  # these just fit


PLACES_M = 10.0
"""Between robots; each stands anywhere within 4 m of a place of its own."""

odd = st.sampled_from([0.0, -0.0, 4.0, 1e-7, 5e-324])
"""Numbers that are easily written wrong."""
near = odd | st.floats(-4.0, 4.0)
positive = st.floats(0.0, 1e3, exclude_min=True)
ids = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}", fullmatch=True) | st.sampled_from(
    ["1", "007", "1e5", "0x1F", "1_0", "true", "null", "2026-01-31", "no", "on"]
)
sensing = st.builds(
    Sensing,
    range_m=st.none() | positive,
    position_noise_m=st.floats(0.0, 1.0),
    dropout=st.floats(0.0, 1.0),
    delay_steps=st.integers(0, 10),
)


@st.composite
def poses(draw: st.DrawFn, place: int) -> Pose:
    x_m = draw(near) + PLACES_M * place if place else draw(near)
    return Pose(x_m=x_m, y_m=draw(near), heading_rad=draw(st.none() | near))


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    names = draw(st.lists(ids, min_size=1, max_size=4, unique=True))
    robots = [
        ScenarioRobot(
            id=name,
            start=draw(poses(place)),
            goal=draw(poses(place)),
            radius_m=draw(st.sampled_from([0.495, 0.4, 0.123456789012345])),
            limits=draw(st.just(Limits()) | st.builds(Limits, speed_mps=positive, jerk_mps3=positive)),
            sensing=draw(st.none() | st.just(Sensing()) | sensing),
        )
        for place, name in enumerate(names)
    ]
    return Scenario(
        name=draw(
            st.text(min_size=1, max_size=64) | st.sampled_from(["8", "1e3", "null", "<<", "=", "- a", "\x85"])
        ),
        robots=robots,
        step_s=draw(st.floats(0.0, 10.0, exclude_min=True)),
        area=Area(x_max_m=draw(st.floats(100.0, 1e6))),
        horizons=Horizons(prediction_steps=draw(st.integers(2, 200))),
        weights=draw(st.just(Weights()) | st.builds(Weights, heading=st.floats(0.0, 1e6))),
        sensing=draw(sensing),
    )


@settings(max_examples=30)
@given(scenarios())
def test_what_is_written_is_read_back_equal(scenario: Scenario) -> None:
    read = load_scenario(Path("written.yaml"), scenario_text(scenario))
    assert read == scenario
    assert repr(read) == repr(scenario)  # which tells −0 from 0; a heading can depend on it


def test_a_file_is_written_as_a_person_would_with_defaults_left_out() -> None:
    path = find("4-crossing")
    assert scenario_text(load_scenario(path)) == path.read_text(encoding="utf-8").partition("\n")[2]
    text = """\
name: Gänge 1–3 “雪”
area: {y_min_m: -3, y_max_m: 3}
time_limit_s: 30
sensing: {range_m: 5.5}
robots:
  - {id: 1, start: {x_m: -4, y_m: 0}, goal: {x_m: 4, y_m: 0.25, heading_rad: 1.57}, sensing: {}}
  - {id: b, start: {x_m: 4, y_m: 0}, goal: {x_m: -4, y_m: 0}, radius_m: 0.4, limits: {speed_mps: 2}}
"""
    read = load_scenario(Path("hall.yaml"), text)
    assert scenario_text(read) == text
    assert [read.sensing_of(robot).range_m for robot in read.robots] == [None, 5.5]
