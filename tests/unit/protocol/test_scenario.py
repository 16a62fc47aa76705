"""The scenario model: published defaults, headings left out, checks of the whole, the public scene."""

import math
from typing import Any

import pytest
from pydantic import ValidationError

from protocol.scenario import Scenario, Sensing


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


def test_the_defaults_are_the_publications() -> None:
    """Table 1, and what its data show of r, the collision distance and the arrival tolerance."""
    it = scenario(A, B)
    scene = it.scene(with_goals=False)
    assert it.step_s == 0.1
    assert (it.horizons.prediction_steps, it.horizons.estimation_steps) == (30, 15)
    assert it.area.model_dump() == {"x_min_m": -10, "x_max_m": 10, "y_min_m": -10, "y_max_m": 10}
    assert it.robots[0].limits.model_dump() == {
        "speed_mps": 4.5,
        "acceleration_mps2": 3.0,
        "turn_rate_radps": 1.57,
        "jerk_mps3": 7.0,
        "turn_acceleration_radps2": 0.5,
    }
    assert it.arrival_tolerance == 0.1
    assert scene.collision_distance_m("a", "b") == pytest.approx(0.7 * math.sqrt(2), abs=1e-3)
    assert scene.safety_distance_m("a", "b") == pytest.approx(0.7 * math.sqrt(2) + 0.4, abs=1e-3)
    assert it.weights.as_tuple() == (1, 1, 0.03, 0.6)
    assert it.sensing == Sensing(
        range_m=None, position_noise_m=0, heading_noise_rad=0, speed_noise_mps=0, dropout=0, delay_steps=0
    )


@pytest.mark.parametrize(
    ("goal", "heading"), [((4, 0), 0), ((-4, 4), math.pi / 2), ((-4, -4), -math.pi / 2), ((-8, 0), math.pi)]
)
def test_a_heading_left_out_points_from_start_to_goal(goal: tuple[float, float], heading: float) -> None:
    (it,) = scenario(robot("a", (-4, 0), goal)).robots
    assert it.start_state() == pytest.approx((-4, 0, heading, 0))
    assert it.goal_pose().as_state() == pytest.approx((*goal, heading, 0))


def test_a_heading_given_stays() -> None:
    given = robot("a", (-4, 0), (4, 0))
    given["start"]["heading_rad"] = 1.0
    given["goal"]["heading_rad"] = -2.0
    (it,) = scenario(given).robots
    assert (it.start_state()[2], it.goal_pose().heading_rad) == (1.0, -2.0)


def test_the_scene_holds_no_goal_and_no_start_unless_asked() -> None:
    it = scenario(A, B, weights={"speed": 0.5}, step_s=0.05)
    scene = it.scene(with_goals=False)
    assert scene.goals is None
    assert set(scene.model_dump()) == {
        "step_s", "area", "horizons", "weights", "arrival_tolerance", "safety_margin_m", "robots", "goals",
    }  # fmt: skip
    assert all(set(public) == {"radius_m", "limits"} for public in scene.model_dump()["robots"].values())
    assert (scene.weights.speed, scene.step_s, list(scene.robots)) == (0.5, 0.05, ["a", "b"])


def test_the_scene_of_exchanged_goals_holds_every_goal() -> None:
    goals = scenario(A, B).scene(with_goals=True).goals
    assert goals is not None
    assert {name: goal.as_state() for name, goal in goals.items()} == {
        "a": (4, 0, 0, 0),
        "b": (0, 4, pytest.approx(math.pi / 2), 0),
    }


def test_a_robots_own_sensing_replaces_that_of_the_scenario() -> None:
    it = scenario(A, {**B, "sensing": {"range_m": 3}}, sensing={"dropout": 0.5})
    first, second = it.robots
    assert it.sensing_of(first).dropout == 0.5
    assert it.sensing_of(second) == Sensing(range_m=3)


def test_different_bodies_keep_their_own_distances() -> None:
    scene = scenario(A, {**B, "radius_m": 1}, safety_margin_m=0.5).scene(with_goals=False)
    assert scene.collision_distance_m("a", "b") == pytest.approx(1.495)
    assert scene.safety_distance_m("a", "b") == pytest.approx(2.495)


OUTSIDE = [
    (robot("a", (-10.01, 0), (4, 0)), "robots.0.start"),
    (robot("a", (-4, 0), (4, 10.01)), "robots.0.goal"),
]


@pytest.mark.parametrize(("outside", "place"), OUTSIDE)
def test_poses_outside_the_area_are_refused(outside: dict[str, Any], place: str) -> None:
    where, what = problem(outside, B)
    assert where == place
    assert what.endswith(" lies outside the area x -10…10, y -10…10 m")


def test_the_border_belongs_to_the_area() -> None:
    assert len(scenario(robot("a", (-10, -10), (10, 10))).robots) == 1


def test_starts_may_be_as_near_as_bodies_and_goals_as_near_as_the_safety_distance() -> None:
    scenario(robot("a", (0, 0), (0, 5)), robot("b", (0.995, 0), (1.395, 5)))
    assert problem(robot("a", (0, 0), (0, 5)), robot("b", (0.985, 0), (3, 5)))[0] == "robots.1.start"
    assert problem(robot("a", (0, 0), (0, 5)), robot("b", (3, 0), (1.385, 5)))[0] == "robots.1.goal"


def test_the_room_of_every_pair_is_checked_with_its_own_radii() -> None:
    wide = robot("c", (0, 3), (0, -5.9), radius_m=3)
    assert problem(A, B, wide, robot("d", (0, 6.4), (7, 7))) == (
        "robots.3.start",
        "the starts of robots 'c' and 'd' are 3.4 m apart, at least 3.495 m are needed: their bodies overlap",
    )


def test_an_id_used_twice_is_refused() -> None:
    assert problem(A, B, robot("a", (3, 3), (-3, -3))) == (
        "robots.2.id",
        "the id 'a' is used twice; ids must differ",
    )


def problem(*robots: dict[str, Any]) -> tuple[str, str]:
    """The place that the one refusal names, and what it says."""
    with pytest.raises(ValidationError) as raised:
        scenario(*robots)
    (error,) = raised.value.errors()
    return error["ctx"]["where"], error["ctx"]["what"]
