"""Small evaluations, and runs that are made in this process or made up."""

from concurrent.futures import Future
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import Result
from typer.testing import CliRunner

from fleet.cli import app
from fleet.evaluate import running
from fleet.evaluate.evaluation import Evaluation
from fleet.record.report import this_machine
from fleet.scenarios.suite import load_suite

SHORT = {
    "horizons": {"prediction_steps": 4, "estimation_steps": 2},
    "time_limit_s": 0.5,
    "robots": [
        {"id": i, "start": {"x_m": 0.0, "y_m": 2.0 * i}, "goal": {"x_m": 4.0, "y_m": 2.0 * i}} for i in (1, 2)
    ],
}
"""Two robots that do not get far."""


def write_suite(directory: Path, *stems: str, **rules: object) -> Path:
    """A directory of short scenarios."""
    directory.mkdir(exist_ok=True)
    for stem in stems:
        content = {"name": stem, **SHORT, **rules}
        (directory / f"{stem}.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return directory


def evaluation_of(suite: Path | str, **choices: Any) -> Evaluation:
    loaded = load_suite(str(suite))
    plain = {
        "suite": loaded.name,
        "goals": ("exchanged", "ioc"),
        "solver": "realtime",
        "seeds": 1,
        "noise": ("none",),
        "machine": this_machine(),
        "scenarios": loaded.scenarios,
    }
    return Evaluation(**{**plain, **choices})


def unspoken_evaluate(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["evaluate", *map(str, arguments)])


class InThisProcess:
    """What an evaluation needs of a Dask client; each run is made when it is submitted, by ``make``."""

    status = "running"

    def __init__(self, make: Any) -> None:
        self.make = make

    def submit(self, _function: Any, run: Any, **_options: object) -> "Future[Any]":
        future: Future[Any] = Future()
        try:
            future.set_result(self.make(run))
        except Exception as error:
            future.set_exception(error)
        return future

    def cancel(self, _futures: object) -> None:
        pass


def use(monkeypatch: pytest.MonkeyPatch, client: InThisProcess) -> None:
    """Let evaluations use this client instead of a cluster."""
    monkeypatch.setattr(running, "local_cluster", lambda _workers: nullcontext(client))
