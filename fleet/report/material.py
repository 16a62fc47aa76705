"""What a report is made from."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from fleet.evaluate.evaluation import Evaluation, Run, RunKey
from fleet.evaluate.results import Row
from fleet.report.measures import Group
from fleet.report.worst import Worst, worst_runs


@dataclass(frozen=True)
class Material:
    """An evaluation and the runs of it that are finished.

    Attributes:
        evaluation: what was to be run.
        rows: what was, in the order of the evaluation.
        against: the method with which the others are compared.
    """

    evaluation: Evaluation
    rows: Sequence[Row]
    against: str

    @cached_property
    def runs(self) -> dict[RunKey, Run]:
        """All runs of the evaluation, made or missing."""
        return {run.key: run for run in self.evaluation.runs()}

    @cached_property
    def levels(self) -> dict[str, list[Group]]:
        """The methods at each level of noise, as far as there are runs."""
        levels: dict[str, list[Group]] = {}
        for noise in self.evaluation.noise:
            for method in self.evaluation.goals:
                rows = [row for row in self.rows if (row.method, row.noise) == (method, noise)]
                if rows:
                    levels.setdefault(noise, []).append(Group(method, noise, rows))
        return levels

    def worst(self, count: int) -> list[Worst]:
        """The worst runs."""
        return worst_runs(self.rows, self.against, count)

    def named(self, row: Row) -> str:
        """A run in words: scenario and method, and noise and seed where they matter."""
        noise = "" if row.noise == "none" else f", noise {row.noise}"
        seeds = sum(key[:-1] == row.key[:-1] for key in self.runs)
        return f"{row.scenario}, {row.method}{noise}" + (f", seed {row.seed}" if seeds > 1 else "")
