"""The hunt: its optimiser on functions with a known minimum, what is kept, and the command."""

import json
import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from run_helpers import ring, truth
from typer.testing import CliRunner

from fleet.cli import app
from fleet.hunt.attempt import ENOUGH, Attempt, Outcome, Points, Standstills, attempt
from fleet.hunt.finds import Finds, Settings
from fleet.hunt.search import Search
from fleet.inject.scenario import load_scenario
from fleet.record.report import this_machine
from fleet.scenarios.wild import coordinates
from protocol.messages import State

SIZE = coordinates(2)
PLANTED = np.random.default_rng(5).uniform(0.05, 0.95, SIZE)


def distances_to(planted: np.ndarray, points: Points) -> list[float]:
    """Squared, with ripples that hold up whoever only follows a slope."""
    offsets = np.array(points) - planted
    ripples = 0.02 * (1.0 - np.cos(8.0 * math.pi * offsets))
    return [float(each) for each in (offsets**2 + ripples).sum(axis=1)]


def searched(
    planted: np.ndarray, budget: int, enough: float = -math.inf
) -> tuple[Search, Points, list[float]]:
    """The search after its budget, with all points and their values."""
    search = Search(SIZE, np.random.default_rng(3), enough)
    points: Points = []
    values: list[float] = []

    def values_of(asked: Points) -> list[float]:
        points.extend(asked)
        values.extend(distances_to(planted, asked))
        return values[-len(asked) :]

    search.run(budget, values_of)
    assert len(points) == budget
    return search, points, values


def test_the_search_finds_a_planted_minimum_that_draws_do_not_come_near() -> None:
    _, points, values = searched(PLANTED, 1000)
    drawn = distances_to(PLANTED, np.random.default_rng(4).random((20_000, SIZE)).tolist())
    assert min(values) < 0.3 * min(drawn)
    best = points[int(np.argmin(values))]
    assert np.abs(np.array(best) - PLANTED).mean() < 0.15
    assert searched(PLANTED, 1000)[1] == points, "the same draws and values give the same points"


def test_points_stay_in_the_cube_where_the_minimum_is_a_corner_of_it() -> None:
    _, points, values = searched(np.ones(SIZE), 500)
    assert np.min(points) >= 0.0
    assert np.max(points) <= 1.0
    assert min(values[250:]) < min(values[:14])


def test_a_start_ends_where_enough_is_found_and_the_next_one_begins_elsewhere() -> None:
    search, points, values = searched(PLANTED, 900, enough=2.0)
    assert search.start > 3
    found = [index for index, value in enumerate(values) if value < 2.0]
    assert np.abs(np.array(points[found[0]]) - points[found[-1]]).max() > 0.05


def test_runs_without_a_value_neither_lead_nor_end_the_search() -> None:
    search = Search(SIZE, np.random.default_rng(3), -math.inf)
    points: Points = []

    def half(asked: Points) -> list[float]:
        points.extend(asked)
        values = distances_to(PLANTED, asked)
        return [math.inf if point[0] < 0.5 else value for point, value in zip(asked, values, strict=True)]

    search.run(400, half)
    assert np.mean([point[0] >= 0.5 for point in points[200:]]) > 0.7
    search.run(50, lambda asked: [math.inf] * len(asked))


def outcome(number: int, **changes: Any) -> Outcome:
    return Outcome(**{"number": number, "verdict": "arrived", "closest": 1.5, "slowdown": 1.0, **changes})


def test_what_hurts_more_has_the_lower_value_and_harm_done_is_enough() -> None:
    near, touching = outcome(0, closest=1.2), outcome(0, closest=0.99)
    assert touching.value("distance") < ENOUGH["distance"] <= near.value("distance") < math.inf
    waited, longer = (outcome(0, standstill_s=s, standstill_share=s / 10.0) for s in (2.0, 10.0))
    lost, both_lost = (outcome(0, missing=number) for number in (1, 2))
    values = [each.value("deadlock") for each in (both_lost, lost, longer, waited)]
    assert values == sorted(values)
    assert lost.value("deadlock") < ENOUGH["deadlock"]
    assert waited.value("deadlock") > ENOUGH["deadlock"]
    assert outcome(0, slowdown=3.0).value("time") < outcome(0, slowdown=2.0).value("time")
    assert outcome(0, verdict="failed").value("distance") == math.inf


SETTINGS = Settings(
    family="wild-noisy", robots=(2, 3), harms=("distance", "time"), goals="ioc", seed=4, runs=9, keep=2
)


def kept(directory: Path, order: list[int]) -> Finds:
    """Six runs of two robots from two starts, two of three; a contact, a lost robot, an exception."""
    finds = Finds(directory, SETTINGS, this_machine(), datetime.now(UTC))
    random = np.random.default_rng(0)
    for robots, start, count in ((2, 0, 3), (2, 1, 3), (3, 0, 2)):
        points = random.random((count, coordinates(robots, noisy=True))).tolist()
        finds.attempts(points, "distance", robots, start)
    closest = [1.4, 1.1, 1.3, 1.2, 1.2, 0.9, 1.15, None]
    for number in order:
        failed = {"verdict": "failed", "reason": "boom"} if closest[number] is None else {}
        finds.add(outcome(number, closest=closest[number], missing=int(number == 2), **failed))
    return finds


def test_of_each_start_the_worst_is_kept_as_a_file_with_the_command_that_repeats_it(tmp_path: Path) -> None:
    finds = kept(tmp_path / "a b", [*range(8)])
    results = finds.write()
    assert [(find.file, find.outcome.number) for find in results.finds] == [
        ("distance-1.yaml", 5),
        ("distance-2.yaml", 1),
        ("deadlock-1.yaml", 2),
        ("time-1.yaml", 0),
        ("time-2.yaml", 3),
        ("failed-1.yaml", 7),
    ]
    assert (results.made, results.contacts, results.not_arrived, results.failed) == (8, 1, 1, 1)
    again = kept(tmp_path / "c", [7, 4, 5, 3, 6, 2, 0, 1]).write()
    assert [find.outcome for find in again.finds] == [find.outcome for find in results.finds]
    for find in results.finds:
        path = tmp_path / "a b" / find.file
        scenario = load_scenario(path)
        tried = finds._tried[find.outcome.number].scenario
        assert scenario == tried.model_copy(update={"name": path.stem})
        assert find.command == f"unspoken simulate '{path}' --goals ioc --seed 4"
        assert find.command in path.read_text().splitlines()[0]
    assert json.loads((tmp_path / "a b" / "results.json").read_text())["schema"] == 1


def test_a_robot_stands_below_a_share_of_its_speed_until_it_has_arrived() -> None:
    """Robots of at most 4.5 m/s, at steps of 0.1 s: one creeps on, one stops for three steps and arrives."""
    scenario = ring(2)
    standstills = Standstills(scenario)
    speeds_mps = {"1": (0.1, -0.3, 0.1, 0.1, 0.3, 0.3), "2": (0.3, 0.3, 0.0, 0.0, 0.0, 0.0)}
    for step in range(6):
        standstills.add(
            truth(
                step,
                {
                    name: {
                        "state": State(x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=speeds[step]),
                        "arrived_s": 0.5 if (name, step) == ("2", 5) else None,
                    }
                    for name, speeds in speeds_mps.items()
                },
            )
        )
    assert standstills.longest_s == 0.3


def hunt(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["hunt", *map(str, arguments)], env={"COLUMNS": "200"})


CHEAP = ("--runs", 3, "--robots", "2", "--for", "time", "--seed", 1)


def test_the_command_finds_the_same_again_and_its_files_repeat_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = hunt(*CHEAP, "--goals", "constant-velocity", "--workers", 2, "--out", "one")
    assert "3 runs: contact in " in result.stdout
    assert (
        hunt(*CHEAP, "--goals", "constant-velocity", "--workers", 1, "--out", "two").exit_code
        == result.exit_code
    )
    [found], [again] = (
        json.loads(Path(name, "results.json").read_text())["finds"] for name in ("one", "two")
    )
    assert found["outcome"] == again["outcome"]
    assert f"\n{found['command']}\n" in result.stdout
    scenario = load_scenario(Path("one", found["file"]))
    repeated = attempt(Attempt(found["outcome"]["number"], "time", 0, scenario, "constant-velocity", 1))
    assert repeated.model_dump() == found["outcome"]
    assert result.exit_code == int(found["outcome"]["missing"] > 0 or found["outcome"]["closest"] < 1.0)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--robots", "2..9"), "scenarios of 2 to 8 robots, not of 9"),
        (("--out", "full"), "full is not empty"),
        (("--for", "trouble"), "trouble"),
        (("--family", "circle"), "circle"),
    ],
)
def test_wrong_usage_is_refused_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("full").mkdir()
    Path("full/thesis.tex").touch()
    result = hunt(*options)
    assert result.exit_code == 2
    assert told in result.stderr
    assert sorted(map(str, Path().rglob("*"))) == ["full", "full/thesis.tex"]
