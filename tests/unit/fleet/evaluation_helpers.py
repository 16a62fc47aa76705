"""Small evaluations."""

from pathlib import Path
from typing import Any

import yaml

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
