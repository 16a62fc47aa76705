"""Evaluations whose runs are made up, and the pages that are made of them."""

from collections.abc import Sequence
from html import unescape
from pathlib import Path
from typing import Any

from click.testing import Result
from evaluation_helpers import evaluation_of, write_suite
from typer.testing import CliRunner

from fleet.cli import app
from fleet.evaluate.evaluation import Run
from fleet.evaluate.results import Row, open_results
from fleet.report.data import Data


def row(run: Run, **figures: Any) -> Row:
    """A run in which both robots arrived, unless told otherwise."""
    plain = {
        "robots": 2,
        "verdict": "arrived",
        "duration_s": 6.0,
        "robot_duration_mean_s": 5.0,
        "driven_m": 16.0,
        "robot_driven_mean_m": 8.0,
        "minimum_distance_m": 1.4,
        "collisions": 0,
        "arrived": 2,
        "steps": 60,
        "solver_failures": 0,
        "clipped_commands": 0,
        "plan_cpu_p50_ms": 1.0,
        "plan_cpu_p99_ms": 2.0,
    }
    return Row(**run.key._asdict(), **(plain | figures))


def never(run: Run, verdict: str = "timeout", arrived: int = 1) -> Row:
    """A run in which not every robot arrived."""
    return row(run, verdict=verdict, duration_s=None, robot_duration_mean_s=None, arrived=arrived)


def write_evaluation(out: Path, stems: Sequence[str], figures: Any, missing: int = 0, **choices: Any) -> Data:
    """A directory of results, of which ``figures`` makes a row of each run but the last ``missing`` ones."""
    evaluation = evaluation_of(write_suite(out.parent / "suite", *stems), **choices)
    runs = list(evaluation.runs())
    rows = [figures(run) for run in runs[: len(runs) - missing]]
    with open_results(out, evaluation) as results:
        for row in rows:
            results.add(row)
    return Data(evaluation, rows, evaluation.goals[0])


def unspoken_report(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["report", *map(str, arguments)])


def page_of(out: Path) -> str:
    return unescape((out / "report.html").read_text(encoding="utf-8"))
