"""Scenario files as they are written: what is read back is the same, and people can read them."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.scenario import Pose, Scenario, ScenarioRobot, Sensing, load_scenario, scenario_text
from protocol.scene import Area, Horizons, Weights
from protocol.vehicle import Limits
from scenarios import find

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


@given(scenarios())
def test_what_is_written_is_read_back_equal(
    tmp_path_factory: pytest.TempPathFactory, scenario: Scenario
) -> None:
    path = tmp_path_factory.getbasetemp() / "written.yaml"
    path.write_text(scenario_text(scenario), encoding="utf-8")
    read = load_scenario(path)
    assert read == scenario
    assert repr(read) == repr(scenario)  # which tells −0 from 0; a heading can depend on it


def test_a_file_is_written_as_the_bundled_ones_are() -> None:
    path = find("4-crossing")
    comment, _, rest = path.read_text(encoding="utf-8").partition("\n")
    assert comment.startswith("#")
    assert scenario_text(load_scenario(path)) == rest


def test_defaults_are_left_out_and_all_else_is_told(tmp_path: Path) -> None:
    text = """\
name: hall 1
area: {y_min_m: -3, y_max_m: 3}
time_limit_s: 30
sensing: {range_m: 5.5}
robots:
  - {id: 1, start: {x_m: -4, y_m: 0}, goal: {x_m: 4, y_m: 0.25, heading_rad: 1.57}, sensing: {}}
  - {id: b, start: {x_m: 4, y_m: 0}, goal: {x_m: -4, y_m: 0}, radius_m: 0.4, limits: {speed_mps: 2}}
"""
    path = tmp_path / "hall.yaml"
    path.write_text(text)
    assert scenario_text(load_scenario(path)) == text
