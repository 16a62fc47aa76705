"""Reports: their tables, the files that they leave, and the worst runs."""

import base64
import re
import shutil
import signal
import statistics
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from evaluation_helpers import evaluation_of, write_suite
from reporting_helpers import never, page_of, row, unspoken_report, write_evaluation
from rich.console import Console

from fleet.evaluate.command import WIDTH, encounter_table
from fleet.evaluate.evaluation import Run
from fleet.evaluate.results import DIED, EXPERIMENT, RUNS, Row
from fleet.evaluate.running import execute
from fleet.inject.scenario import load_scenario
from fleet.report import command
from fleet.report.command import worst_runs
from fleet.report.data import Data, publication
from fleet.report.figures import Chart
from fleet.report.page import (
    compose,
    encounters,
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


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


@pytest.fixture
def data(out: Path) -> Data:
    return write_evaluation(out, STEMS, figures, goals=METHODS)


@pytest.fixture(autouse=True)
def _coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are empty, pictures and intervals coarse, which otherwise take the most time."""
    monkeypatch.setattr("fleet.record.picture.DOTS_PER_INCH", 20)
    monkeypatch.setattr(Chart, "png", lambda chart: b"picture of " + chart.title.encode())
    monkeypatch.setattr("fleet.report.data.RESAMPLES", 200)


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
    assert rows["joint-fit"][0].text == "7.75"
    assert rows["joint-fit"][0].small[1:] == ["unfinished as longest: 8.00"]


def test_endings_and_durations_are_those_of_the_runs(data: Data):
    (level,) = data.levels
    ended = endings(level, PLANNED).rows
    assert [cell.text for cell in ended["joint-fit"]] == ["5", "4", "0", "1", "0", "0", "0", "0"]
    assert [cell.bad for cell in ended["joint-fit"]] == [False, True, False, True, *4 * [False]]
    assert ended["ioc"][6] == ("10", ["published 0"], True), "fallbacks"
    cells = scenario_by_scenario(level, "exchanged").rows["c"]
    assert [cell.text for cell in cells] == ["2", "6.5", "9.0", "–"]
    assert [cell.small for cell in cells[2:]] == [["+2.5"], ["deadlock"]]
    assert timings(level).rows["ioc"][0].text == "–", "nothing is made up where nothing was measured"


def test_encounters_are_quantiles_over_runs_and_a_run_counts_by_its_pair_steps(out: Path):
    closest = dict(zip(STEMS, (0.9, 1.0, 1.1, 1.2, 1.3), strict=True))

    def met(run: Run) -> Row:
        if run.key.method == "ioc":
            return Row.without_result(run, "boom")
        first = run.key.scenario == "a"
        return row(
            run,
            closest_to_collision=closest[run.key.scenario],
            closest_to_safety=closest[run.key.scenario] / 2.0,
            side_disagreement=0.5 if first else None,
            side_pair_steps=30 if first else 0,
            interventions=2,
        )

    data = write_evaluation(out, STEMS, met, goals=("exchanged", "ioc"))
    rows = encounters(data.levels[0]).rows
    texts = ["0.900", "0.904", "0.940", "1.100", "0.450", "0.452", "0.470", "0.550", "50.0%", "10"]
    assert [cell.text for cell in rows["exchanged"]] == texts
    assert [cell.bad for cell in rows["exchanged"]] == [True] + 9 * [False]
    assert rows["exchanged"][8].small == ["of 30 pair-steps"]
    assert [cell.text for cell in rows["ioc"]] == 9 * ["–"] + ["0"]
    console = Console(width=WIDTH)
    with console.capture() as capture:
        console.print(encounter_table(data.rows))
    [told] = [line.split() for line in capture.get().splitlines() if "exchanged" in line]
    assert told[1:] == ["none", "0.9", "0.904", "0.94", "1.1", "0.45", "0.452", "0.47", "0.55", "50.0%", "10"]


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


def test_an_unfinished_evaluation_is_reported_as_far_as_it_is(out: Path):
    data = write_evaluation(out, STEMS, figures, goals=METHODS, missing=4)
    assert unspoken_report(out, "--against", "psychic").exit_code == 2
    result = unspoken_report(out, "--worst", 0, "--against", "ioc")
    assert result.exit_code == 0
    told = "Unfinished: 4 of 15 runs are missing (exchanged: 1, ioc: 1, joint-fit: 2)"
    assert told in result.stderr
    assert told in page_of(out)
    assert endings(data.levels[0], PLANNED).rows["joint-fit"][0].text == "3 of 5"


def test_one_run_is_enough_even_one_that_failed(out: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.undo()
    monkeypatch.setattr("fleet.report.figures.DOTS_PER_INCH", 20)  # figures of nothing can be drawn
    failed = write_evaluation(out, ("a",), lambda run: Row.without_result(run, "no way"), goals=("ioc",))
    page = compose(failed, ())
    assert [picture.png[:4] for picture in page.pictures] == 4 * [b"\x89PNG"]
    assert "Beside" not in page.html
    assert medians(failed.levels[0]).rows["ioc"][0].small[0] == "unfinished as longest: never"


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
    addresses = re.findall(r'\b(?:src|href|srcset|action)="([^"]*)"', html)
    inlined = [base64.b64decode(each.removeprefix("data:image/png;base64,")) for each in addresses]
    assert inlined == [first[f"report-{name}.png"] for name in names]
    again = compose(data, ())
    assert again.html == html
    assert {picture.file: picture.png for picture in again.pictures}.items() <= first.items()


def test_without_an_evaluation_or_a_finished_run_there_is_nothing_to_report(tmp_path: Path, out: Path):
    write_evaluation(out, ("a",), figures, missing=2)
    for directory, told in ((tmp_path, "holds no evaluation"), (out, "not one run")):
        result = unspoken_report(directory)
        assert result.exit_code == 2
        assert told in result.stderr
        assert not (directory / "report.html").exists()


def test_failed_runs_come_first_then_collisions_then_robots_that_never_arrive_then_slow_ones(out: Path):
    evaluation = evaluation_of(write_suite(out, *"abcdefghi"))
    runs = {run.key[:2]: run for run in evaluation.runs()}

    def ioc(stem: str) -> Run:
        return runs[stem, "ioc"]

    rows = [
        row(runs["a", "exchanged"], duration_s=6.0),
        row(ioc("a"), duration_s=9.0),
        row(runs["b", "exchanged"], duration_s=10.0),
        row(ioc("b"), duration_s=12.0),
        never(ioc("c"), "timeout", arrived=1),
        never(ioc("d"), "deadlock", arrived=0),
        row(ioc("e"), collisions=1, minimum_distance_m=0.9),
        row(ioc("f"), collisions=1, minimum_distance_m=0.8),
        row(ioc("g"), collisions=2, minimum_distance_m=0.95),
        Row.without_result(ioc("h"), "ArithmeticError: no way"),
        row(ioc("i"), duration_s=9.0),
    ]
    told = worst_runs(rows, "exchanged", 20)
    whys = {row.scenario: why for row, why in told if row.method == "ioc"}
    assert list(whys) == list("hgfedcabi")
    assert whys["h"] == "failed: ArithmeticError: no way"
    assert whys["c"] == "timeout: 1 of 2 robots arrived"
    assert whys["a"] == "took 9.0 s, 1.50 times as long as with exchanged"
    assert worst_runs(rows, "exchanged", 2) == told[:2]


def test_the_worst_run_is_driven_again_as_it_was_and_the_told_command_repeats_it(out: Path):
    data = write_evaluation(out, ("short",), execute, goals=("joint-fit",), noise=("low",))
    assert unspoken_report(out, "--worst", 1).exit_code == 0
    page, file = page_of(out), out / "report-worst-1.yaml"
    assert "timeout: 0 of 2 robots arrived" in page
    assert "The picture shows another run" not in page
    assert (out / "report-worst-1.png").read_bytes().startswith(b"\x89PNG")
    assert f"unspoken simulate {file} --goals joint-fit --solver realtime --seed 0" in page
    (run,) = data.runs.values()
    assert load_scenario(file) == run.scenario
    assert run.scenario.sensing.position_noise_m == 0.02


@pytest.fixture
def reported(out: Path) -> Callable[[Callable[[Run], Row]], str]:
    """The page of an evaluation of one run."""

    def made(figures: Callable[[Run], Row]) -> str:
        write_evaluation(out, ("short",), figures, goals=("exchanged",))
        assert unspoken_report(out, "--worst", 3).exit_code == 0
        return page_of(out)

    return made


def test_a_run_that_fails_again_is_drawn_as_far_as_it_came_and_another_run_is_told(
    reported, out: Path, monkeypatch: pytest.MonkeyPatch
):
    whole = command.closed_loop

    def breaking(*arguments):
        for moment in whole(*arguments):
            if moment.truth.step == 3:
                raise ArithmeticError("no way")
            yield moment

    monkeypatch.setattr(command, "closed_loop", breaking)
    told = reported(lambda run: Row.without_result(run, "ArithmeticError: no way (x.py:1)"))
    assert "failed: ArithmeticError: no way (x.py:1)" in told
    assert "The picture shows another run" not in told
    assert "The run of the picture ended with" not in told, "it is the same one"
    assert (out / "report-worst-1.png").exists()
    shutil.rmtree(out)
    told = reported(row)
    assert "The picture shows another run than the evaluation's" in told
    assert "verdict failed instead of arrived" in told
    assert "The run of the picture ended with ArithmeticError: no way" in told


def test_a_run_that_killed_its_worker_is_not_made_in_this_process(
    reported, out: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(command, "closed_loop", None)
    assert "it might end this process too" in reported(lambda run: Row.without_result(run, DIED))
    assert not (out / "report-worst-1.png").exists()


def test_ctrl_c_leaves_no_report(out: Path, monkeypatch: pytest.MonkeyPatch):
    whole = command.closed_loop

    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        return whole(*arguments)

    monkeypatch.setattr(command, "closed_loop", interrupted)
    write_evaluation(out, ("short",), never, goals=("exchanged",))
    result = unspoken_report(out)
    assert result.exit_code == 1
    assert "Interrupted: no report was written" in result.stderr
    assert {path.name for path in out.iterdir()} == {EXPERIMENT, RUNS}
