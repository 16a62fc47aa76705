"""Evaluations whose runs are made up, and the pages that are made of them."""

import re
from collections.abc import Sequence
from html import unescape
from pathlib import Path
from typing import Any

from click.testing import Result
from evaluation_helpers import evaluation_of, write_suite
from typer.testing import CliRunner

from fleet.cli import app
from fleet.evaluate.evaluation import Evaluation, Run
from fleet.evaluate.results import Results, Row


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


def never(run: Run, verdict: str = "timeout") -> Row:
    """A run in which one robot did not arrive."""
    return row(run, verdict=verdict, duration_s=None, robot_duration_mean_s=None, arrived=1)


def write_evaluation(
    out: Path, stems: Sequence[str], figures: Any, missing: int = 0, **choices: Any
) -> Evaluation:
    """A directory of results.

    Args:
        out: the directory.
        stems: of the scenarios.
        figures: makes a row of a run.
        missing: so many runs at the end were not made.
        **choices: fields of the evaluation that are not as usual.
    """
    evaluation = evaluation_of(write_suite(out.parent / "suite", *stems), **choices)
    runs = list(evaluation.runs())
    with Results(out, evaluation) as results:
        for run in runs[: len(runs) - missing]:
            results.add(figures(run))
    return evaluation


def unspoken_report(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["report", *map(str, arguments)])


class Parsed:
    """What a page consists of; its text is escaped, so that a ``<`` always begins a tag.

    Attributes:
        tables: by caption, the cells of each row; lines of a cell stand apart by ``|``.
    """

    def __init__(self, html: str) -> None:
        self.tags = re.findall(r"<(\w+)", html)
        self.addresses = re.findall(r'\b(?:src|href|srcset|action)="([^"]*)"', html)
        self.alternatives = [unescape(text) for text in re.findall(r'\balt="([^"]*)"', html)]
        self.text = _text(html)
        self.tables: dict[str, list[list[str]]] = {}
        for caption, table in re.findall(r"<caption>(.*?)</caption>(.*?)</table>", html, re.DOTALL):
            rows = re.findall(r"<tr>(.*?)</tr>", table, re.DOTALL)
            cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, re.DOTALL) for row in rows]
            self.tables[_text(caption)] = [[_text(cell) for cell in row] for row in cells]

    def table(self, beginning: str) -> dict[str, list[str]]:
        """The table whose caption begins so: its rows by the first cell."""
        ((_, *rows),) = [rows for caption, rows in self.tables.items() if caption.startswith(beginning)]
        return {cells[0]: cells[1:] for cells in rows}


def _text(html: str) -> str:
    return unescape(re.sub(r"<[^>]*>", "", html.replace("<small>", "|")))


def page_of(out: Path) -> Parsed:
    return Parsed((out / "report.html").read_text(encoding="utf-8"))
