"""Families and suites of scenarios: made, written, read back, and the bundled one."""

import math
import tomllib
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from chassis.refusal import Refusal
from fleet.cli import app
from fleet.inject.scenario import Scenario, load_scenario
from fleet.scenarios.suite import FAMILIES, FamilyName, generate, load_suite, write_suite
from scenarios import find

MOST = {"perimeter": 16, "heterogeneous": 16}
"""The largest number of robots of a family, where it is less than that of a scenario."""


@pytest.fixture(autouse=True)
def _in_an_empty_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("COLUMNS", "TERMINAL_WIDTH"):
        monkeypatch.setenv(name, "200")


def scenarios(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["scenarios", *map(str, arguments)])


def sizes(scenarios: dict[str, Scenario]) -> list[int]:
    return [len(scenario.robots) for scenario in scenarios.values()]


def test_numbers_of_robots_are_gone_through_in_turn_and_names_sort_as_numbers_do() -> None:
    made = generate("circle", [8, 8, 12], 21, seed=0)
    assert list(made)[:4] == ["circle-08-01", "circle-08-02", "circle-12-01", "circle-08-03"]
    assert [made[name].name for name in made] == list(made)
    assert sizes({name: made[name] for name in sorted(made)}) == [8] * 14 + [12] * 7


def test_scenarios_of_a_suite_differ_and_depend_on_the_seed_alone() -> None:
    def ways(seed: int, count: int) -> list[str]:
        return [str(scenario.robots) for scenario in generate("perimeter", [4], count, seed).values()]

    assert ways(1, 6) == ways(1, 9)[:6]
    assert len({*ways(1, 9), *ways(2, 9)}) == 18


def test_a_suite_is_read_as_it_was_written_sorted_by_stem(monkeypatch: pytest.MonkeyPatch) -> None:
    made = dict(zip(("b", "a-1", "a"), generate("heterogeneous", [3, 2], 3, seed=4).values(), strict=True))
    Path("a/mine").mkdir(parents=True)
    write_suite(Path("a/mine"), made, "why")
    suite = load_suite("a/mine")
    assert suite.name == "mine"
    assert list(suite.scenarios.items()) == sorted(made.items())
    assert Path("a/mine/b.yaml").read_text().startswith("# why\nname: het")
    assert [path.name for path in Path("a").iterdir()] == ["mine"]
    monkeypatch.chdir("a/mine")
    assert load_suite(".") == suite


def test_a_directory_that_is_filled_meanwhile_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Path.write_text

    def disturbed(path: Path, text: str, **options: str) -> int:
        Path("mine").mkdir(exist_ok=True)
        Path("mine/thesis.tex").touch()
        return whole(path, text, **options)

    monkeypatch.setattr(Path, "write_text", disturbed)
    with pytest.raises(Refusal, match="mine cannot be used for the output: Directory not empty"):
        write_suite(Path("mine"), generate("circle", [2], 3, seed=0), "why")
    assert sorted(map(str, Path().rglob("*"))) == ["mine", "mine/thesis.tex"]


def test_what_is_no_suite_is_told_with_the_reason_for_each_file() -> None:
    with pytest.raises(Refusal, match=r"did you mean 'forty'\?"):
        load_suite("fourty")
    Path("mine").mkdir()
    with pytest.raises(Refusal, match=r"^mine: .* at least one scenario file, and no \*\.yaml is there"):
        load_suite("mine")
    for stem in ("bad", "worse"):
        Path(f"mine/{stem}.yaml").write_text("name: a\n")
    with pytest.raises(Refusal) as raised:
        load_suite("mine")
    told = [f"mine/{stem}.yaml:1: robots: this field is missing" for stem in ("bad", "worse")]
    assert str(raised.value).splitlines() == told


def test_forty_is_the_perimeter_family_with_8a_for_the_first_of_eight_robots() -> None:
    made = generate("perimeter", range(2, 9), 40, seed=2026)
    del made["perimeter-8-01"]
    made["8a"] = load_scenario(find("8a"))
    suite = load_suite("forty")
    assert suite.name == "forty"
    assert list(suite.scenarios.items()) == sorted(made.items())
    assert load_suite("8a") == ("8a", {"8a": made["8a"]}), "a single scenario is a suite of one"


def test_the_installed_package_holds_every_bundled_file() -> None:
    root = Path(__file__).parents[3]
    tool = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]
    assert tool["package-data"]["*"] == ["*.yaml"]
    folders = {path.parent.relative_to(root) for path in (root / "scenarios").rglob("*.yaml")}
    assert {".".join(folder.parts) for folder in folders} <= set(tool["packages"])


def test_the_first_line_of_a_generated_file_is_the_command_that_makes_it_again() -> None:
    options = ("--family", "corridor", "--robots", "3,5..6", "--count", 4, "--seed", 7)
    result = scenarios("generate", *options, "--out", "new/one")
    assert result.stdout == "Wrote 4 scenarios of 3–6 robots to new/one.\n"
    (first,) = {path.read_text().splitlines()[0] for path in Path("new/one").iterdir()}
    command = first.removeprefix("# Made by unspoken scenarios ")
    assert scenarios(*command.split(), "--out", "other").exit_code == 0
    for path in Path("new/one").iterdir():
        assert path.read_bytes() == (Path("other") / path.name).read_bytes()
    assert sizes(load_suite("other").scenarios) == [3, 3, 5, 6]


WRONG_NUMBERS = ("", "0", "129", "8..2", "2..", "2,,8", "four", "²")


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--robots", "17"), "has room for 16 robots, not for 17"),
        *((("--robots", wrong), f"'{wrong}' found") for wrong in WRONG_NUMBERS),
        (("--out", "full"), "full is not empty; choose another directory with --out, or remove it"),
        (("--out", "full/thesis.tex/suite"), "cannot be used for the output: Not a directory"),
        (("--out", "."), "is where you are"),
    ],
)
def test_wrong_usage_is_refused_and_nothing_is_written(options: tuple[str, ...], told: str) -> None:
    Path("full").mkdir()
    Path("full/thesis.tex").write_text("of great value")
    result = scenarios("generate", "--out", "mine", *options)
    assert result.exit_code == 2
    assert told in result.stderr
    assert sorted(map(str, Path().rglob("*"))) == ["full", "full/thesis.tex"]


def drawn(family: FamilyName, robots: int, seed: int) -> Scenario:
    return FAMILIES[family](robots, np.random.default_rng(seed))


def for_any(*families: FamilyName):
    """Give a test a few scenarios of these families; most are small, some as large as can be."""

    @st.composite
    def scenarios(draw: st.DrawFn) -> Scenario:
        family = draw(st.sampled_from(families))
        robots = draw(st.integers(1, 12) | st.just(MOST.get(family, 40)))
        return drawn(family, robots, draw(st.integers(0, 2**32)))

    return lambda test: settings(max_examples=5 * len(families))(given(scenarios())(test))


@for_any(*(family for family in FAMILIES if not family.startswith("wild")))  # which test_wild.py tests
def test_scenarios_are_valid_and_nobody_starts_or_parks_too_near_to_others_or_to_the_border(
    scenario: Scenario,
) -> None:
    ids = [robot.id for robot in scenario.robots]
    assert ids == [str(index + 1) for index in range(int(scenario.name.rpartition("-")[2]))]
    assert Scenario.model_validate(scenario.model_dump()) == scenario
    for one, other in combinations(scenario.robots, 2):
        safe_m = one.radius_m + other.radius_m + 0.4
        for a, b in ((one.start, other.start), (one.goal, other.goal)):
            assert math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)) >= safe_m
    for robot in scenario.robots:
        for pose in (robot.start, robot.goal):
            assert scenario.area.x_min_m + 2 <= pose.x_m <= scenario.area.x_max_m - 2
            assert scenario.area.y_min_m + 1 <= pose.y_m <= scenario.area.y_max_m - 1
            assert (pose.x_m, pose.y_m) == (round(pose.x_m, 3), round(pose.y_m, 3))
        if not scenario.name.startswith("random"):
            assert math.dist(*((each.x_m, each.y_m) for each in (robot.start, robot.goal))) >= 8 - 0.002
            assert robot.start.heading_rad is robot.goal.heading_rad is None


def test_a_robot_on_an_axis_heads_along_it_and_not_half_a_turn_the_other_way_round() -> None:
    class Unturned:
        def uniform(self, _low: float, _high: float) -> float:
            return 0.0

    headings = [robot.start_state()[2] for robot in FAMILIES["circle"](2, Unturned()).robots]
    assert [str(heading) for heading in headings] == [str(math.pi), "0.0"]


@for_any("perimeter", "heterogeneous")
def test_on_the_perimeter_everybody_drives_to_the_opposite_side(scenario: Scenario) -> None:
    for robot in scenario.robots:
        start, goal = ((pose.x_m, pose.y_m) for pose in (robot.start, robot.goal))
        assert {*start, *goal} <= {-4, -2, 0, 2, 4}
        assert any(abs(here) == 4 and there == -here for here, there in zip(start, goal, strict=True))


@for_any("circle")
def test_on_a_circle_everybody_drives_through_its_middle_and_neighbours_are_equally_far_apart(
    scenario: Scenario,
) -> None:
    starts = [(robot.start.x_m, robot.start.y_m) for robot in scenario.robots]
    assert [(-robot.goal.x_m, -robot.goal.y_m) for robot in scenario.robots] == starts
    radius_m = math.hypot(*starts[0])
    assert [math.hypot(*start) for start in starts] == pytest.approx([radius_m] * len(starts), abs=0.002)
    around = [math.dist(one, other) for one, other in zip(starts, starts[1:] + starts[:1], strict=True)]
    assert around == pytest.approx([around[0]] * len(around), abs=0.003)


@for_any("corridor")
def test_in_a_corridor_two_equal_groups_change_sides_between_walls(scenario: Scenario) -> None:
    assert (scenario.area.y_min_m, scenario.area.y_max_m) == (-3, 3)
    eastward = [robot for robot in scenario.robots if robot.start.x_m < 0]
    assert len(eastward) - len(scenario.robots) / 2 in (0, 0.5)
    for robot in scenario.robots:
        assert min(abs(robot.start.x_m), abs(robot.goal.x_m)) >= 4
        assert (robot.start.x_m < 0) != (robot.goal.x_m < 0)
        assert {robot.start.y_m, robot.goal.y_m} <= {-2, 0, 2}
    for robots in (eastward, [robot for robot in scenario.robots if robot.start.x_m > 0]):
        in_front_first = sorted(robots, key=lambda robot: abs(robot.start.x_m))
        depths = [abs(robot.goal.x_m) for robot in in_front_first]
        assert depths == sorted(depths, reverse=True), "a parked robot stands in the way of those behind it"


@for_any("intersection")
def test_at_an_intersection_two_equal_streams_cross_at_a_right_angle(scenario: Scenario) -> None:
    robots = scenario.robots
    east = [r for r in robots if r.start.y_m == r.goal.y_m and r.start.x_m <= -4 and r.goal.x_m >= 4]
    north = [r for r in robots if r.start.x_m == r.goal.x_m and r.start.y_m <= -4 and r.goal.y_m >= 4]
    assert len(east) + len(north) == len(robots)
    assert len(east) - len(north) in (0, 1)
    assert {r.start.y_m for r in east} | {r.start.x_m for r in north} <= {-1, 1}
    for lane in (-1, 1):
        stream = sorted((r.start.x_m, r.goal.x_m) for r in east if r.start.y_m == lane)
        assert stream == sorted(stream, key=lambda way: way[1]), "somebody has to overtake in a lane"


def test_heterogeneous_robots_differ_in_radius_and_in_every_limit() -> None:
    robots = drawn("heterogeneous", 8, 1).robots
    assert len({robot.radius_m for robot in robots}) > 4
    for limit in type(robots[0].limits).model_fields:
        assert len({getattr(robot.limits, limit) for robot in robots}) > 4
