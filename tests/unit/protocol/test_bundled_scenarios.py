"""The bundled scenarios load, are what they say, and are found by name."""

import math

import pytest

from chassis.refusal import Refusal
from protocol.scenario import Scenario, load_scenario
from scenarios import bundled_scenarios, find

SQUARE = [(x, y) for y in (4, 0, -4) for x in (-4, 0, 4) if (x, y) != (0, 0)]


@pytest.mark.parametrize("name", bundled_scenarios())
def test_every_robot_crosses_the_square_from_border_to_border(name: str) -> None:
    scenario = load_scenario(find(name))
    assert scenario.name == name
    for robot in scenario.robots:
        ends = [(pose.x_m, pose.y_m) for pose in (robot.start, robot.goal)]
        assert all(max(abs(x_m), abs(y_m)) == 4 for x_m, y_m in ends)
        assert math.dist(*ends) >= 8


def test_8a_is_the_published_scenario_and_what_it_writes_out_is_the_default() -> None:
    scenario = load_scenario(find("8a"))
    assert [(r.start.x_m, r.start.y_m) for r in scenario.robots] == SQUARE
    assert [r.id for r in scenario.robots] == list("12345678")
    assert scenario == Scenario(name="8a", robots=scenario.robots)
    assert scenario.model_fields_set == Scenario.model_fields.keys() - {"faults"}
    for robot in scenario.robots:
        assert (robot.goal.x_m, robot.goal.y_m) == (-robot.start.x_m, -robot.start.y_m)
        heading = robot.start_state()[2]
        assert robot.goal_pose().heading_rad == heading
        assert math.cos(heading) * robot.start.x_m + math.sin(heading) * robot.start.y_m == pytest.approx(
            -math.hypot(robot.start.x_m, robot.start.y_m)
        )


@pytest.mark.parametrize(("wanted", "meant"), [("8b", "8a"), ("x" * 5000, None), ("a\0b", None)])
def test_an_unknown_name_is_refused_with_the_nearest_one(wanted: str, meant: str | None) -> None:
    with pytest.raises(Refusal) as raised:
        find(wanted)
    assert str(raised.value).startswith(f"{wanted}: ")
    end = f"; did you mean '{meant}'?" if meant else ""
    assert str(raised.value).endswith(f"the bundled ones are 2-crossing, 3-crossing, 4-crossing, 8a{end}")
