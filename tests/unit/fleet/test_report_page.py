"""The tables of a report and the files that it leaves; the runs are made up."""

import base64
import re
import statistics
from collections import Counter
from pathlib import Path

import pytest
from reporting_helpers import never, page_of, row, unspoken_report, write_evaluation

from fleet.evaluate.evaluation import Run
from fleet.evaluate.results import EXPERIMENT, RUNS, Row
from fleet.report import command
from fleet.report.data import Data, publication
from fleet.report.figures import Chart
from fleet.report.page import (
    comparisons,
    compose,
    endings,
    medians,
    noise_sweep,
    scenario_by_scenario,
    timings,
)

STEMS = ("a", "b", "c", "d", "e")
METHODS = ("exchanged", "ioc", "joint-fit")
LOW = "low+dropout=0.3"
DURATIONS_S = {
    "exchanged": (6.0, 7.0, 6.5, 9.0, 7.5),
    "ioc": (10.0, 8.0, 9.0, 9.0, 12.0),
    "joint-fit": (6.0, 7.5, None, 8.5, 8.0),
}
PLANNED = Counter(dict.fromkeys(METHODS, 5))


def figures(run: Run) -> Row:
    duration_s = DURATIONS_S[run.key.method][STEMS.index(run.key.scenario)]
    if duration_s is None:
        return never(run, "deadlock")
    return row(run, duration_s=duration_s, solver_failures=2 if run.key.method == "ioc" else 0)


def failed(run: Run) -> Row:
    return Row.without_result(run, "ArithmeticError: <b>no way</b>")


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


@pytest.fixture
def data(out: Path) -> Data:
    return write_evaluation(out, STEMS, figures, goals=METHODS)


@pytest.fixture(autouse=True)
def _coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither figures nor intervals need to be fine here."""
    monkeypatch.setattr("fleet.report.figures.DOTS_PER_INCH", 30)
    monkeypatch.setattr("fleet.report.data.RESAMPLES", 200)


@pytest.fixture
def _undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are empty, for tests that look at other things: drawing takes the most time."""
    monkeypatch.setattr(Chart, "png", lambda _self: b"no picture")


def test_medians_stand_beside_the_published_ones_and_count_who_never_arrived_as_longest(data: Data):
    (level,) = data.levels
    rows = medians(level).rows
    forty = publication()["forty_scenarios"]
    for method, place in (("exchanged", 0), ("ioc", 1)):
        own_s = statistics.median(DURATIONS_S[method])
        interval, published = rows[method][0].small
        assert float(rows[method][0].text) == pytest.approx(own_s)
        low, high = map(float, interval.split(" … "))
        assert low <= own_s <= high
        assert published == f"published {forty['duration_all_robots_s']['median'][place]:.2f}"
        smallest = forty["minimum_distance_m"]["smallest"][place]
        assert f"published smallest {smallest:.3f}" in rows[method][4].small
    assert rows["joint-fit"][0].text == "7.75"
    assert rows["joint-fit"][0].small[1:] == ["unfinished as longest: 8.00"]


def test_endings_durations_and_times_are_those_of_the_runs(data: Data):
    (level,) = data.levels
    ended = endings(level, PLANNED).rows
    assert [cell.text for cell in ended["joint-fit"]] == ["5", "4", "0", "1", "0", "0", "0", "0"]
    assert [cell.bad for cell in ended["joint-fit"]] == [False, True, False, True, *4 * [False]]
    assert ended["ioc"][6] == ("10", ["published 0"], True), "fallbacks"
    cells = scenario_by_scenario(level, "exchanged").rows["c"]
    assert cells == [
        ("2", (), False),
        ("6.5", [], False),
        ("9.0", ["+2.5"], False),
        ("–", ["deadlock"], True),
    ]
    times = timings(level).rows["ioc"]
    assert times[4:6] == [("1", ["highest 1"], False), ("2", ["highest 2"], False)]
    assert times[0].text == "–", "nothing is made up where nothing was measured"


def test_differences_are_those_in_the_same_scenario(data: Data):
    rows = comparisons(data.levels[0], "ioc").rows
    assert rows.keys() == {"exchanged", "joint-fit"}
    pairs = zip(DURATIONS_S["joint-fit"], DURATIONS_S["ioc"], strict=True)
    both = [(one, other) for one, other in pairs if one is not None]
    ours, theirs = (statistics.median(each) for each in zip(*both, strict=True))
    told = rows["joint-fit"][0]
    assert told.text == f"{ours / theirs:.3f}"
    assert told.small[1].startswith(f"{statistics.median(one - other for one, other in both):+.2f} s (")
    assert told.small[-1] == "4 less, 0 equal, 0 more"
    assert f"published {6.5 / 10.55:.2f}" in rows["exchanged"][0].small


def test_levels_of_noise_stand_beside_one_another(out: Path):
    def noisy(run: Run) -> Row:
        slower = {"none": 1.0, LOW: 1.1}[run.key.noise]
        seconds = slower * (6.0 + STEMS.index(run.key.scenario)) + 0.2 * run.key.seed
        return row(run, duration_s=seconds, collisions=int(run.key[:1] + run.key[3:] == ("b", LOW, 1)))

    data = write_evaluation(out, STEMS[:3], noisy, goals=("exchanged", "ioc"), noise=("none", LOW), seeds=2)
    none, low = noise_sweep(data.levels).rows["ioc"]
    assert none.text == "7.00"
    assert low.text == f"{1.1 * 7.0 + 0.1:.2f}", "the mean of two seeds is the value of a scenario"
    assert low.small[0].startswith(f"{(1.1 * 7.0 + 0.1) / 7.0:.3f} times (")
    assert low.small[1:] == ["1 of 6 runs with a collision"]


@pytest.mark.usefixtures("_undrawn")
def test_an_unfinished_evaluation_is_reported_as_far_as_it_is(out: Path):
    data = write_evaluation(out, STEMS, figures, goals=METHODS, missing=4)
    result = unspoken_report(out, "--worst", 0, "--against", "ioc")
    assert result.exit_code == 0
    told = "Unfinished: 4 of 15 runs are missing (exchanged: 1, ioc: 1, joint-fit: 2)"
    assert told in result.stderr
    assert told in page_of(out)
    assert "Not all robots arrived in 1 of 11 runs (joint-fit: 1)" in result.stderr
    assert "Beside ioc" in page_of(out)
    assert endings(data.levels[0], PLANNED).rows["joint-fit"][0].text == "3 of 5"
    assert scenario_by_scenario(data.levels[0], "ioc").rows["d"][-1].text == "missing"


def test_one_run_is_enough_even_one_that_failed(out: Path):
    data = write_evaluation(out, ("a",), failed, goals=("ioc",))
    page = compose(data, ())
    assert [picture.png[:4] for picture in page.pictures] == 4 * [b"\x89PNG"]
    assert "Beside" not in page.html
    (level,) = data.levels
    assert [cell.text for cell in endings(level, PLANNED).rows["ioc"][1:6]] == ["0", "0", "0", "0", "1"]
    longest, published = medians(level).rows["ioc"][0].small
    assert (longest, published) == ("unfinished as longest: never", "published 10.55")


def test_the_page_needs_nothing_from_elsewhere_and_the_same_evaluation_gives_the_same_files(
    data: Data, out: Path
):
    (out / "report-worst-9.png").write_bytes(b"left from an older report")
    (out / "mine.png").write_bytes(b"no part of any report")
    assert unspoken_report(out, "--worst", 0).exit_code == 0
    first = {path.name: path.read_bytes() for path in out.iterdir()}
    names = ("duration", "driven", "distance", "times")
    assert first.keys() == {EXPERIMENT, RUNS, "mine.png", "report.html", *(f"report-{n}.png" for n in names)}
    html = first["report.html"].decode()
    assert not {"script", "link", "iframe", "object"} & set(re.findall(r"<(\w+)", html))
    assert "url(" not in html
    addresses = re.findall(r'\b(?:src|href|srcset|action)="([^"]*)"', html)
    inlined = [base64.b64decode(each.removeprefix("data:image/png;base64,")) for each in addresses]
    assert inlined == [first[f"report-{name}.png"] for name in names]
    assert all(len(told) > 40 for told in re.findall(r'\balt="([^"]*)"', html))
    again = compose(data, ())
    assert again.html == html
    assert {picture.file: picture.png for picture in again.pictures}.items() <= first.items()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--against", "psychic"), "'psychic' found, one of the methods of this evaluation is expected"),
        (("--worst", -1), "--worst"),
    ],
)
@pytest.mark.usefixtures("data")
def test_wrong_usage_is_refused_and_nothing_is_written(out: Path, arguments: tuple[object, ...], told: str):
    result = unspoken_report(out, *arguments)
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.replace("│", " ").split())
    assert {path.name for path in out.iterdir()} == {EXPERIMENT, RUNS}


def test_without_an_evaluation_or_a_finished_run_there_is_nothing_to_report(tmp_path: Path, out: Path):
    write_evaluation(out, ("a",), figures, missing=2)
    for directory, told in ((tmp_path, "holds no evaluation"), (out, "not one run")):
        result = unspoken_report(directory)
        assert result.exit_code == 2
        assert told in result.stderr
        assert not (directory / "report.html").exists()


@pytest.mark.usefixtures("_undrawn", "data")
def test_a_disk_that_takes_nothing_is_told(out: Path, monkeypatch: pytest.MonkeyPatch):
    def full(path: Path, _content: object) -> None:
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(command, "write_whole", full)
    result = unspoken_report(out, "--worst", 0)
    assert result.exit_code == 3
    assert "report-duration.png: cannot be written: No space left on device" in result.stderr
    assert not (out / "report.html").exists()
