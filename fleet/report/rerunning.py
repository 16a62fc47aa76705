"""Runs of an evaluation made again in virtual time, for their pictures."""

import io
import shlex
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from fleet.evaluate.evaluation import Run
from fleet.evaluate.results import DIED, FAILED, Row
from fleet.record.picture import Course, draw_paths
from fleet.record.summary import Summary, Tally
from fleet.report.material import Material
from fleet.report.page import Picture, WorstRun
from fleet.report.worst import Worst
from fleet.run.virtual import closed_loop
from protocol.messages import Truth


class Rerun(NamedTuple):
    """A run made again."""

    picture: bytes
    """PNG."""
    failure: str
    """The exception with which it ended; empty if it did not."""
    differences: tuple[str, ...]
    """In what it is not the run of the evaluation; none where software and processor are the same."""


def shown_again(
    material: Material,
    worst: Worst,
    path: Path,
    show: Callable[[Truth], None],
    interrupted: Callable[[], bool],
) -> WorstRun:
    """One of the worst runs as the page shows it.

    Args:
        material: the evaluation.
        worst: the run.
        path: of its files, without their suffix.
        show: given each step while it is driven again.
        interrupted: asked once a step.

    Raises:
        KeyboardInterrupt: it was interrupted.
    """
    run, title = material.runs[worst.row.key], material.named(worst.row)
    command = ["unspoken", "simulate", str(path.with_suffix(".yaml")), "--goals", run.goals]
    command += ["--solver", run.solver, "--seed", str(run.key.seed)]
    plain = WorstRun(title, worst.why, None, (), shlex.join(command))
    if worst.row.reason == DIED:
        return plain._replace(remarks=("Not driven again for a picture: it might end this process too.",))
    try:
        again = rerun(run, worst.row, show, interrupted)
    except ModuleNotFoundError as error:
        return plain._replace(remarks=(f"Not driven again for a picture: {error} on this machine.",))
    picture = Picture(
        path.with_suffix(".png").name,
        again.picture,
        f"{title}: the ways driven, the robots, their goals and what these were taken for, at three times.",
    )
    return plain._replace(picture=picture, remarks=tuple(_remarks(again, worst)))


def _remarks(again: Rerun, worst: Worst) -> Iterator[str]:
    if again.differences:
        yield (
            "The picture shows another run than the evaluation's: this software on this machine drives it "
            f"with {', '.join(again.differences)}."
        )
    if again.failure and again.failure not in worst.why:
        yield f"The run of the picture ended with {again.failure}."


def rerun(run: Run, row: Row, show: Callable[[Truth], None], interrupted: Callable[[], bool]) -> Rerun:
    """Drive a run of an evaluation again and draw it; one that fails is drawn as far as it came.

    Args:
        run: what to drive.
        row: what came of it in the evaluation.
        show: given each step.
        interrupted: asked once a step.

    Raises:
        KeyboardInterrupt: it was interrupted.
        ModuleNotFoundError: the library of a baseline is not installed here.
    """
    facts = run.facts
    tally, course = Tally(), Course(run.scenario.step_s)
    failure = ""
    try:
        for moment in closed_loop(run.scenario, facts, time.thread_time, interrupted):
            show(moment.truth)
            for message in (moment.truth, *(decision.mind for decision in moment.decisions.values())):
                tally.add(message)
                course.add(message)
            if interrupted():
                raise KeyboardInterrupt
    except ModuleNotFoundError:
        raise
    except Exception as error:  # the very one that is looked for, or another one, which is told
        failure = f"{type(error).__name__}: {error}"
    summary = tally.summary(facts, FAILED)
    picture = io.BytesIO()
    draw_paths(run.scenario, course, summary, picture)
    return Rerun(picture.getvalue(), failure, _differences(row, summary))


def _differences(row: Row, summary: Summary) -> tuple[str, ...]:
    again = {
        "verdict": (row.verdict, summary.verdict),
        **(
            {}
            if row.failed  # such a row holds nothing more
            else {
                "duration": (row.duration_s, summary.duration_s),
                "smallest distance": (row.minimum_distance_m, summary.minimum_distance_m),
                "steps": (row.steps, summary.steps),
            }
        ),
    }
    return tuple(f"{name} {now} instead of {then}" for name, (then, now) in again.items() if then != now)
