"""The bundled scenarios load, are what they say, and are found by name."""

import math
from pathlib import Path

import pytest

from chassis.refusal import Refusal
from protocol.scenario import Scenario, ScenarioRobot, load_scenario
from scenarios import bundled_scenarios, find

SQUARE = [(x, y) for y in (4, 0, -4) for x in (-4, 0, 4) if (x, y) != (0, 0)]


def test_the_bundled_scenarios_are_these() -> None:
    assert list(bundled_scenarios()) == ["2-crossing", "3-crossing", "4-crossing", "8a"]


@pytest.mark.parametrize("name", bundled_scenarios())
def test_a_bundled_scenario_loads_under_its_own_name(name: str) -> None:
    assert load_scenario(find(name)).name == name


@pytest.mark.parametrize("name", bundled_scenarios())
def test_every_robot_crosses_the_square_from_border_to_border(name: str) -> None:
    for robot in load_scenario(find(name)).robots:
        for pose in (robot.start, robot.goal):
            assert max(abs(pose.x_m), abs(pose.y_m)) == 4
        assert math.hypot(robot.goal.x_m - robot.start.x_m, robot.goal.y_m - robot.start.y_m) >= 8


@pytest.mark.parametrize(("name", "number"), [("2-crossing", 2), ("3-crossing", 3), ("4-crossing", 4)])
def test_in_a_crossing_every_way_meets_another(name: str, number: int) -> None:
    ways = [on_the_way(robot) for robot in load_scenario(find(name)).robots]
    assert len(ways) == number
    for one in ways:
        assert any(math.dist(a, b) < 0.1 for other in ways if other is not one for a in one for b in other)


def on_the_way(robot: ScenarioRobot) -> list[tuple[float, float]]:
    """Points of the line from start to goal, a hundredth of it apart."""
    start, goal, parts = robot.start, robot.goal, [part / 100 for part in range(101)]
    return [(start.x_m + p * (goal.x_m - start.x_m), start.y_m + p * (goal.y_m - start.y_m)) for p in parts]


def test_8a_is_the_published_scenario() -> None:
    scenario = load_scenario(find("8a"))
    assert [(r.start.x_m, r.start.y_m) for r in scenario.robots] == SQUARE
    assert [r.id for r in scenario.robots] == list("12345678")
    assert scenario.time_limit_s == 60
    for robot in scenario.robots:
        assert (robot.goal.x_m, robot.goal.y_m) == (-robot.start.x_m, -robot.start.y_m)
        heading = robot.start_state()[2]
        assert robot.goal_pose().heading_rad == heading
        assert math.cos(heading) * robot.start.x_m + math.sin(heading) * robot.start.y_m == pytest.approx(
            -math.hypot(robot.start.x_m, robot.start.y_m)
        )


def test_what_8a_writes_out_is_the_default() -> None:
    scenario = load_scenario(find("8a"))
    assert scenario == Scenario(name="8a", robots=scenario.robots)
    assert scenario.model_fields_set == Scenario.model_fields.keys() - {"faults"}


def test_a_path_is_found_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.touch()
    assert find(str(path)) == path


@pytest.mark.parametrize(
    ("wanted", "meant"),
    [("8b", "8a"), ("4-crosing", "4-crossing"), ("scenarios/2-crossing.yml", "2-crossing")],
)
def test_an_unknown_name_is_refused_with_the_nearest_one(wanted: str, meant: str) -> None:
    with pytest.raises(Refusal) as raised:
        find(wanted)
    assert str(raised.value).startswith(f"{wanted}: ")
    assert "the bundled ones are 2-crossing, 3-crossing, 4-crossing, 8a; " in str(raised.value)
    assert str(raised.value).endswith(f"did you mean '{meant}'?")


@pytest.mark.parametrize("wanted", ["zzz", "x" * 5000, "a\0b"])
def test_a_name_like_no_other_is_told_without_a_guess(wanted: str) -> None:
    with pytest.raises(Refusal, match=r"4-crossing, 8a$"):
        find(wanted)
