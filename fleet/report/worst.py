"""The worst runs: which they are, what made them so, and their pictures, for which they are driven again."""

import io
import math
import shlex
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from fleet.evaluate.evaluation import Run
from fleet.evaluate.results import DIED, FAILED, Row
from fleet.record.picture import Course, draw_paths
from fleet.record.summary import Summary, Tally
from fleet.report.figures import Picture
from fleet.run.virtual import closed_loop
from protocol.messages import Truth


class Worst(NamedTuple):
    """One of the worst runs, and why it is."""

    row: Row
    why: str


class WorstRun(NamedTuple):
    """One of the worst runs as the page shows it."""

    title: str
    why: str
    picture: Picture | None
    remarks: Sequence[str]
    command: str
    """What repeats it."""


def worst_runs(rows: Sequence[Row], against: str, count: int) -> list[Worst]:
    """The worst runs first: failed ones, then with collisions, then without arrival, then the slowest.

    Slow is what takes long beside the same scenario, noise and seed with the reference method.

    Args:
        rows: all runs.
        against: the reference method.
        count: most that are wanted.
    """
    base_s = {(row.scenario, row.noise, row.seed): row.duration_s for row in rows if row.method == against}

    def ratio(row: Row) -> float | None:
        base = base_s.get((row.scenario, row.noise, row.seed))
        # Whoever starts at its goal arrives after 0 s.
        return row.duration_s / base if row.duration_s is not None and base else None

    ranked = sorted(rows, key=lambda row: _rank(row, ratio(row)))
    return [Worst(row, _why(row, against, ratio(row))) for row in ranked[:count]]


def _rank(row: Row, ratio: float | None) -> tuple[float, ...]:
    """The smaller, the worse; sorting is stable, so of equals the earlier one comes first."""
    if row.failed:
        return (0.0,)
    nearest_m = math.inf if row.minimum_distance_m is None else row.minimum_distance_m
    if row.collisions:
        return 1.0, -float(row.collisions), nearest_m
    if row.duration_s is None:
        return 2.0, (row.arrived or 0) / row.robots, nearest_m
    return 3.0, -(ratio or 0.0), -row.duration_s


def _why(row: Row, against: str, ratio: float | None) -> str:
    if row.failed:
        return f"failed: {row.reason}"
    if row.collisions:
        pairs = "1 pair of robots" if row.collisions == 1 else f"{row.collisions} pairs of robots"
        return f"collision of {pairs}"
    if row.duration_s is None:
        return f"{row.verdict}: {row.arrived} of {row.robots} robots arrived"
    took = f"took {row.duration_s:.1f} s"
    compared = ratio is not None and row.method != against
    return f"{took}, {ratio:.2f} times as long as with {against}" if compared else took


def driven_again(
    run: Run,
    worst: Worst,
    title: str,
    path: Path,
    show: Callable[[Truth], None],
    interrupted: Callable[[], bool],
) -> WorstRun:
    """Drive one of the worst runs again for its picture; one that fails is drawn as far as it came.

    Args:
        run: what to drive.
        worst: what came of it in the evaluation.
        title: of the run.
        path: of its files, without their suffix.
        show: takes each step.
        interrupted: asked once a step.

    Raises:
        KeyboardInterrupt: it was interrupted.
    """
    command = ["unspoken", "simulate", str(path.with_suffix(".yaml")), "--goals", run.goals]
    command += ["--solver", run.solver, "--seed", str(run.key.seed)]
    plain = WorstRun(title, worst.why, None, (), shlex.join(command))
    if worst.row.reason == DIED:
        return plain._replace(remarks=["Not driven again for a picture: it might end this process too."])
    tally, course, failure = Tally(), Course(run.scenario.step_s), ""
    try:
        for moment in closed_loop(run.scenario, run.facts, time.thread_time, interrupted):
            show(moment.truth)
            for message in (moment.truth, *(decision.mind for decision in moment.decisions.values())):
                tally.add(message)
                course.add(message)
            if interrupted():
                raise KeyboardInterrupt
    except ModuleNotFoundError as error:  # the library of a baseline
        return plain._replace(remarks=[f"Not driven again for a picture: {error} on this machine."])
    except Exception as error:  # the very one that is looked for, or another one, which is reported
        failure = f"{type(error).__name__}: {error}"
    summary = tally.summary(run.facts, FAILED)
    png = io.BytesIO()
    draw_paths(run.scenario, course, summary, png)
    words = f"{title}: the ways driven, the robots, their goals and the estimates of these, at three times."
    remarks = []
    if differences := _differences(worst.row, summary):
        remarks.append(
            "The picture shows another run than the evaluation's: this software on this machine drives it "
            f"with {', '.join(differences)}."
        )
    if failure and failure not in worst.why:
        remarks.append(f"The run of the picture ended with {failure}.")
    picture = Picture(path.with_suffix(".png").name, png.getvalue(), words)
    return plain._replace(picture=picture, remarks=remarks)


def _differences(row: Row, summary: Summary) -> list[str]:
    """In what a run is not that of the evaluation; none where software and processor are the same."""
    names = {"verdict": "verdict"}
    if not row.failed:  # such a row holds nothing more
        names |= {"duration": "duration_s", "smallest distance": "minimum_distance_m", "steps": "steps"}
    both = {name: (getattr(row, field), getattr(summary, field)) for name, field in names.items()}
    return [f"{name} {now} instead of {then}" for name, (then, now) in both.items() if then != now]
