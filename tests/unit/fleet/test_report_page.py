"""What the page of an evaluation says; the runs are made up."""

import base64
import statistics
from itertools import product
from pathlib import Path

import pytest
from matplotlib.image import imread
from reporting_helpers import Parsed, never, page_of, row, unspoken_report, write_evaluation

from fleet.evaluate.evaluation import Run
from fleet.evaluate.results import EXPERIMENT, RUNS, Row
from fleet.report.data import publication
from fleet.report.figures import Chart

STEMS = ("a", "b", "c", "d", "e")
METHODS = ("exchanged", "ioc", "joint-fit")
LOW = "low+dropout=0.3"
DURATIONS_S = {
    ("exchanged", "none"): (6.0, 7.0, 6.5, 9.0, 7.5),
    ("ioc", "none"): (10.0, 8.0, 9.0, 9.0, 12.0),
    ("joint-fit", "none"): (6.0, 7.5, None, 8.5, 8.0),
}


def figures(run: Run) -> Row:
    duration_s = DURATIONS_S[run.key.method, run.key.noise][STEMS.index(run.key.scenario)]
    if duration_s is None:
        return never(run, "deadlock")
    return row(run, duration_s=duration_s, solver_failures=2 if run.goals == "ioc" else 0)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    write_evaluation(tmp_path / "out", STEMS, figures, goals=METHODS)
    return tmp_path / "out"


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same evaluation with its report, for tests that only read."""
    out = tmp_path_factory.mktemp("reported") / "out"
    write_evaluation(out, STEMS, figures, goals=METHODS)
    (out / "report-worst-9.png").write_bytes(b"left from an older report")
    (out / "mine.png").write_bytes(b"no part of any report")
    assert unspoken_report(out, "--worst", 0).exit_code == 0
    return out


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are empty, for tests that look at other things: drawing takes the most time."""
    monkeypatch.setattr(Chart, "png", lambda _self: b"no picture")


@pytest.fixture(scope="module")
def page(reported: Path) -> Parsed:
    return page_of(reported)


def test_medians_stand_beside_the_published_ones(page: Parsed):
    table = page.table("Medians over scenarios")
    forty = publication()["forty_scenarios"]
    for method, place in (("exchanged", 0), ("ioc", 1)):
        own_s = statistics.median(DURATIONS_S[method, "none"])
        value, interval, published = table[method][0].split("|")
        assert float(value) == pytest.approx(own_s)
        low, high = map(float, interval.split(" … "))
        assert low <= own_s <= high
        assert published == f"published {forty['duration_all_robots_s']['median'][place]:.2f}"
        assert f"published {forty['driven_distance_all_m']['median'][place]:.2f}" in table[method][2]
        assert f"published smallest {forty['minimum_distance_m']['smallest'][place]:.3f}" in table[method][4]
    assert "published" not in "".join(table["joint-fit"])


def test_runs_that_did_not_arrive_are_told_and_counted_as_longest(page: Parsed):
    value, _, longest = page.table("Medians over scenarios")["joint-fit"][0].split("|")
    assert value == "7.75"
    assert longest == "unfinished as longest: 8.00"
    assert "Not all robots arrived in 1 of 15 runs (joint-fit: 1)" in page.text
    assert page.table("How the runs ended")["joint-fit"][:6] == ["5", "4", "0", "1", "0", "0"]
    assert page.table("Duration of each scenario")["c"] == ["2", "6.5", "9.0|+2.5", "–|deadlock"]


def test_differences_are_those_in_the_same_scenario(out: Path, undrawn: None):
    assert unspoken_report(out, "--worst", 0, "--against", "ioc").exit_code == 0
    table = page_of(out).table("Beside ioc")
    assert table.keys() == {"exchanged", "joint-fit"}
    told = table["joint-fit"][0].split("|")
    both = [
        (one, other)
        for one, other in zip(DURATIONS_S["joint-fit", "none"], DURATIONS_S["ioc", "none"], strict=True)
        if one is not None
    ]
    ours, theirs = (statistics.median(each) for each in zip(*both, strict=True))
    assert told[0] == f"{ours / theirs:.3f}"
    assert told[2].startswith(f"{statistics.median(one - other for one, other in both):+.2f} s (")
    assert told[-1] == "4 less, 0 equal, 0 more"
    assert f"published {6.5 / 10.55:.2f}" in table["exchanged"][0]


def test_fallbacks_and_times_are_told(page: Parsed):
    assert page.table("How the runs ended")["ioc"][6] == "10|published 0"
    assert page.table("CPU time")["ioc"][4:6] == ["1|highest 1", "2|highest 2"]
    assert page.table("CPU time")["ioc"][0] == "–", "nothing is made up where nothing was measured"


def test_the_page_needs_nothing_from_elsewhere(reported: Path, page: Parsed):
    assert len(page.addresses) == 4
    assert all(address.startswith("data:image/png;base64,") for address in page.addresses)
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    assert "url(" not in (reported / "report.html").read_text()
    assert all(len(alternative) > 40 for alternative in page.alternatives)
    inlined = [base64.b64decode(address.partition(",")[2]) for address in page.addresses]
    names = ("duration", "driven", "distance", "times")
    assert inlined == [(reported / f"report-{name}.png").read_bytes() for name in names]


def test_the_same_evaluation_gives_the_same_files_byte_by_byte(reported: Path, tmp_path: Path):
    first = {path.name: path.read_bytes() for path in reported.iterdir()}
    for name in (EXPERIMENT, RUNS):
        (tmp_path / name).write_bytes(first[name])
    assert unspoken_report(tmp_path, "--worst", 0).exit_code == 0
    again = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert {"report.html", "report-duration.png"} <= again.keys()
    assert all(first[name] == content for name, content in again.items())


def test_what_an_older_report_left_goes_and_nothing_else(reported: Path):
    assert not (reported / "report-worst-9.png").exists()
    assert (reported / "mine.png").exists()


def test_machine_version_suite_and_date_are_told(page: Parsed):
    for told in ("Evaluation of suite", "realtime", "unspoken 0.1.0", "Python 3.", "not noted", "15 of 15"):
        assert told in page.text


def test_an_unfinished_evaluation_is_reported_as_far_as_it_is(tmp_path: Path, undrawn: None):
    write_evaluation(tmp_path / "out", STEMS, figures, goals=METHODS, missing=4)
    result = unspoken_report(tmp_path / "out", "--worst", 0)
    assert result.exit_code == 0
    told = "Unfinished: 4 of 15 runs are missing (exchanged: 1, ioc: 1, joint-fit: 2)"
    assert told in result.stderr
    page = page_of(tmp_path / "out")
    assert told in page.text
    assert page.table("How the runs ended")["joint-fit"][0] == "3 of 5"
    assert page.table("Duration of each scenario")["d"] == ["2", "9.0", "9.0|0.0", "missing"]


def test_levels_of_noise_have_figures_of_their_own_and_a_table_beside_one_another(
    tmp_path: Path, undrawn: None
):
    def noisy(run: Run) -> Row:
        slower = {"none": 1.0, LOW: 1.1}[run.key.noise]
        seconds = slower * (6.0 + STEMS.index(run.key.scenario)) + 0.2 * run.key.seed
        return row(run, duration_s=seconds, collisions=int(run.key[:1] + run.key[3:] == ("b", LOW, 1)))

    out = tmp_path / "out"
    write_evaluation(out, STEMS[:3], noisy, goals=("exchanged", "ioc"), noise=("none", LOW), seeds=2)
    assert unspoken_report(out, "--worst", 0).exit_code == 0
    names = {path.name for path in out.glob("*.png")}
    assert names == {
        f"report-{name}-{level}.png"
        for name, level in product(("duration", "driven", "distance", "times"), ("none", LOW))
    }
    none, low = page_of(out).table("Median duration in s by noise")["ioc"]
    assert none == "7.00"
    value, ratio, collided = low.split("|")
    assert value == f"{1.1 * 7.0 + 0.1:.2f}", "the mean of two seeds is the value of a scenario"
    assert ratio.startswith(f"{(1.1 * 7.0 + 0.1) / 7.0:.3f} times (")
    assert collided == "1 of 6 runs with a collision"


def test_one_method_and_one_scenario_are_enough(tmp_path: Path):
    write_evaluation(tmp_path / "out", ("a",), row, goals=("joint-fit",))
    assert unspoken_report(tmp_path / "out", "--worst", 0).exit_code == 0
    page = page_of(tmp_path / "out")
    assert page.table("Medians over scenarios")["joint-fit"][0].split("|")[0] == "6.00"
    assert not [caption for caption in page.tables if caption.startswith("Beside")]


def test_an_evaluation_in_which_every_run_failed_is_reported_too(tmp_path: Path):
    def failed(run: Run) -> Row:
        return Row.without_result(run.key, 2, "ArithmeticError: <b>no way</b>")

    write_evaluation(tmp_path / "out", ("a", "b"), failed)
    assert unspoken_report(tmp_path / "out", "--worst", 0).exit_code == 0
    page = page_of(tmp_path / "out")
    assert page.table("How the runs ended")["ioc"][:6] == ["2", "0", "0|published 0", "0", "0", "2"]
    assert page.table("Medians over scenarios")["ioc"][0] == "–|unfinished as longest: never|published 10.55"
    assert imread(tmp_path / "out" / "report-duration.png").size


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--against", "psychic"), "'psychic' found, one of the methods of this evaluation is expected"),
        (("--worst", -1), "--worst"),
    ],
)
def test_wrong_usage_is_refused_and_nothing_is_written(out: Path, arguments: tuple[object, ...], told: str):
    result = unspoken_report(out, *arguments)
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.replace("│", " ").split())
    assert {path.name for path in out.iterdir()} == {EXPERIMENT, RUNS}


def test_a_directory_without_an_evaluation_is_refused(tmp_path: Path):
    result = unspoken_report(tmp_path)
    assert result.exit_code == 2
    assert "holds no evaluation" in result.stderr
    assert "unspoken evaluate" in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_an_evaluation_without_a_finished_run_is_refused(tmp_path: Path):
    write_evaluation(tmp_path / "out", STEMS, figures, goals=METHODS, missing=15)
    result = unspoken_report(tmp_path / "out")
    assert result.exit_code == 2
    assert "not one run of this evaluation is finished" in result.stderr
    assert not (tmp_path / "out" / "report.html").exists()
