"""The family ``wild``: whatever point of the cube, a scenario in which all robots can do what they are to."""

import math
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chassis.refusal import Refusal
from fleet.inject.scenario import Scenario
from fleet.scenarios.suite import generate
from fleet.scenarios.wild import Own, Shared, coordinates, scenario_at, time_alone_s
from protocol.scenario import load_scenario, scenario_text
from protocol.vehicle import STANDSTILL, Limits, braking_input, stopping_distance_m, stopping_time_s

SHARES = st.floats(0.0, 1.0) | st.sampled_from([0.0, 0.5, 1.0])


@st.composite
def points(draw: st.DrawFn) -> tuple[list[float], int, bool]:
    """A point of the cube, also at a corner or with robots alike; their number; whether they see badly."""
    robots, noisy = draw(st.integers(2, 8)), draw(st.booleans())
    size = coordinates(robots, noisy=noisy)
    if draw(st.booleans()):
        return draw(st.lists(SHARES, min_size=size, max_size=size)), robots, noisy
    seen = [draw(SHARES) for _ in range(3 * noisy)]
    shared, own = ([draw(SHARES) for _ in of._fields] for of in (Shared, Own))
    return [*shared, *own * robots, *seen], robots, noisy


@settings(max_examples=150, deadline=None)
@given(points())
def test_whatever_point_of_the_cube_robots_fit_their_ways_and_stand_in_nobodys_place(
    point: tuple[list[float], int, bool],
) -> None:
    scenario = scenario_at(point[0], point[1])
    assert load_scenario(Path("wild.yaml"), scenario_text(scenario)).model_dump() == scenario.model_dump()
    places = [(pose, robot) for robot in scenario.robots for pose in (robot.start, robot.goal)]
    for (a, one), (b, other) in combinations(places, 2):
        distance_m = math.dist((a.x_m, a.y_m), (b.x_m, b.y_m))
        if one is other:
            assert 3.0 <= distance_m <= 60.0
        else:
            assert distance_m >= one.radius_m + other.radius_m + 2.0 * scenario.safety_margin_m
    for robot in scenario.robots:
        limits = robot.limits
        assert 0.2 <= limits.speed_mps <= 6.0
        assert 0.1 <= robot.radius_m <= 1.0
        assert scenario.horizons.prediction_steps * scenario.step_s >= stopping_time_s(limits)
        assert 2.0 * time_alone_s(robot) <= scenario.time_limit_s <= 1500 * scenario.step_s
        for pose in (robot.start, robot.goal):
            room_m = scenario.area.x_max_m - max(abs(pose.x_m), abs(pose.y_m))
            assert room_m >= 4.0 * robot.radius_m
    assert 0.05 <= scenario.step_s <= 0.2
    assert scenario.horizons.prediction_steps <= 80


def test_the_family_holds_what_is_promised_of_it_and_noise_changes_nothing_but_what_is_seen() -> None:
    """Of two hundred draws, some are near each end of every range."""
    made = list(generate("wild", range(2, 9), 210, seed=0).values())
    noisy = list(generate("wild-noisy", range(2, 9), 210, seed=0).values())
    for clear, blurred in zip(made, noisy, strict=True):
        assert blurred.model_copy(update={"name": clear.name, "sensing": clear.sensing}) == clear

    def spans(low: float, high: float, values: list[float]) -> bool:
        return min(values) <= 1.25 * low and max(values) >= 0.8 * high

    robots = [robot for scenario in made for robot in scenario.robots]
    assert spans(0.2, 6.0, [robot.limits.speed_mps for robot in robots])
    assert spans(0.1, 1.0, [robot.radius_m for robot in robots])
    assert spans(0.05, 0.2, [scenario.step_s for scenario in made])
    assert spans(0.01, 100.0, [scenario.weights.x for scenario in made])
    ways_m = [math.dist(*((pose.x_m, pose.y_m) for pose in (each.start, each.goal))) for each in robots]
    assert spans(3.0, 60.0, ways_m)
    turned = [robot.start.heading_rad is not None for robot in robots]
    assert 0.2 < sum(turned) / len(turned) < 0.4
    sensed = [scenario.sensing for scenario in noisy]
    assert {sensing.position_noise_m for sensing in sensed} == {0.0, 0.02, 0.04}
    assert {sensing.delay_steps for sensing in sensed} == {0, 1, 2}
    assert 0.28 < max(sensing.dropout for sensing in sensed) <= 0.3
    assert {sensing.range_m for sensing in sensed} == {None}


def gap_of_straight_ways_m(scenario: Scenario) -> float:
    """The least distance of two bodies if all drove straight and each arrived when the others do."""
    shares = np.linspace(0.0, 1.0, 201)[:, np.newaxis]
    courses = [
        (1.0 - shares) * (robot.start.x_m, robot.start.y_m) + shares * (robot.goal.x_m, robot.goal.y_m)
        for robot in scenario.robots
    ]
    return min(
        float(np.linalg.norm(courses[i] - courses[j], axis=1).min())
        - scenario.robots[i].radius_m
        - scenario.robots[j].radius_m
        for i, j in combinations(range(len(courses)), 2)
    )


def test_most_robots_that_drove_straight_would_touch() -> None:
    made = generate("wild", [2, 4], 100, seed=1).values()
    meeting = [len(scenario.robots) for scenario in made if gap_of_straight_ways_m(scenario) < 0.0]
    assert meeting.count(2) > 15
    assert meeting.count(4) > 35


@pytest.mark.parametrize("robots", [1, 9])
def test_a_number_of_robots_that_the_family_has_no_scenarios_for_is_refused(robots: int) -> None:
    with pytest.raises(Refusal, match=f"of 2 to 8 robots, not of {robots}"):
        generate("wild", [robots], 1, seed=0)


@settings(max_examples=30)
@given(
    st.builds(
        Limits,
        *(),
        speed_mps=st.floats(0.2, 6),
        acceleration_mps2=st.floats(0.2, 4),
        jerk_mps3=st.floats(0.5, 10),
    )
)
def test_stopping_takes_as_long_as_a_vehicle_brakes(limits: Limits) -> None:
    step_s, speed_mps, driven_m, steps, last = 0.01, limits.speed_mps, 0.0, 0, STANDSTILL
    while speed_mps > 1e-3 * limits.speed_mps:
        last = braking_input(limits, last, speed_mps, step_s)
        driven_m += speed_mps * step_s
        speed_mps += last.acceleration_mps2 * step_s
        steps += 1
    assert steps * step_s == pytest.approx(stopping_time_s(limits), rel=0.05, abs=0.01)
    assert driven_m == pytest.approx(stopping_distance_m(limits), rel=0.02, abs=0.01)
