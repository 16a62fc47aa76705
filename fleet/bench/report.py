"""The report of a bench, and the targets that its figures are held against.

Its JSON is a contract, described in docs/performance.md.
"""

import time
from collections import defaultdict
from collections.abc import Sequence
from typing import Literal

from pydantic import Field
from rich.console import Console

from agent.process.warm import warm_up
from chassis.files import Record
from fleet.bench.bus import BusRow
from fleet.bench.decisions import ComparisonRow, DecisionRow, PredictionRow
from fleet.bench.measuring import Progress, Row, SectionName, Settings, table
from fleet.bench.processes import CompilingRow, RunRow, StartupRow
from fleet.interruption import announced, compile_solver
from fleet.record.report import Machine, new_table, number, this_machine

SECTIONS: dict[SectionName, type[Row]] = {
    SectionName.PREDICTION: PredictionRow,
    SectionName.COMPARISON: ComparisonRow,
    SectionName.DECISION: DecisionRow,
    SectionName.BUS: BusRow,
    SectionName.RUNS: RunRow,
    SectionName.STARTUP: StartupRow,
    SectionName.COMPILING: CompilingRow,
}


PREDICTION_P99_MS = {8: 10.0, 16: 25.0, 32: 100.0}
"""By number of robots, how long the joint prediction of a random crossing may take."""


class Figures(Record):
    """Rows by section; a section that was not measured has none."""

    prediction: tuple[PredictionRow, ...] = ()
    comparison: tuple[ComparisonRow, ...] = ()
    decision: tuple[DecisionRow, ...] = ()
    bus: tuple[BusRow, ...] = ()
    runs: tuple[RunRow, ...] = ()
    startup: tuple[StartupRow, ...] = ()
    compiling: tuple[CompilingRow, ...] = ()


class Target(Record):
    """One figure and its bound."""

    what: str
    unit: str
    measured: float | None
    """The worst of the figures that it is about; None: not measured."""
    bound: Literal["at most", "at least"]
    limit: float
    met: bool | None
    """None: not measured."""


def judge(figures: Figures) -> tuple[Target, ...]:
    """What the figures should be, and whether they are."""
    of_8a = [r for r in figures.decision if r.scenario == "8a"]
    random = [r for r in figures.prediction if r.scenario == "random"]
    eight = [r for r in random if r.robots == 8]
    against = [r for r in figures.comparison if r.scenario == "8a"]
    alike = [abs(r.cost_difference_percent) for r in figures.comparison if r.same_minimum]
    runs = [r for r in figures.runs if r.scenario == "8a"]
    real = [r for r in runs if r.clock == "realtime"]
    decision, crossings, faster = "whole decision, 8a, CPU time", "random crossings of 8", "times faster"
    rivals = "joint prediction, 8a, against the reference"
    ready, compiling = "an agent's process, ready after its start", "compiling from nothing, CPU time"
    return (
        _most(f"{decision}, median", 6.0, "ms", [r.later.cpu.median_ms for r in of_8a]),
        _most(f"{decision}, p99", 25.0, "ms", [r.later.cpu.p99_ms for r in of_8a]),
        _most(f"{decision}, first from a standing start", 250.0, "ms", [r.first.cpu.max_ms for r in of_8a]),
        *(
            _most(
                f"joint prediction, random crossings of {robots}, CPU time, p99",
                limit_ms,
                "ms",
                [r.later.cpu.p99_ms for r in random if r.robots == robots],
            )
            for robots, limit_ms in PREDICTION_P99_MS.items()
        ),
        _least(f"{rivals}, medians", 100.0, faster, [r.times_faster_median for r in against]),
        _least(f"{rivals}, p99", 100.0, faster, [r.times_faster_p99 for r in against]),
        _most("cost of a closed loop, off the reference in the same minimum", 0.1, "%", alike),
        _most(f"{crossings}, too close as driven", 1e-3, "m", [r.driven_shortfall_m for r in eight]),
        _most(f"{crossings}, too close as predicted", 1e-3, "m", [r.predicted_shortfall_m for r in eight]),
        _most(f"{crossings}, unsolved", 0.0, "problems", [r.unsolved for r in eight]),
        _least(
            "8a in lock-step", 10.0, "steps a second", [r.steps_per_s for r in runs if r.clock == "lockstep"]
        ),
        _most("8a in real time, deadline misses", 1.0, "%", [r.deadline_misses_percent for r in real]),
        _most("8a in real time, collisions", 0.0, "pairs", [r.collisions for r in real]),
        _most("8a in real time, not arrived", 0.0, "robots", [r.not_arrived for r in real]),
        _most("an agent's process, resident", 250.0, "MiB", [r.agent_resident_mib for r in runs]),
        _most(ready, 3.0, "s", [r.ready_s for r in figures.startup if r.together == 1]),
        _most(compiling, 60.0, "s", [r.cpu_s for r in figures.compiling if r.cache == "empty"]),
    )


def _most(what: str, limit: float, unit: str, values: Sequence[float]) -> Target:
    worst = max(values, default=None)
    met = None if worst is None else worst <= limit
    return Target(what=what, unit=unit, measured=worst, bound="at most", limit=limit, met=met)


def _least(what: str, limit: float, unit: str, values: Sequence[float]) -> Target:
    worst = min(values, default=None)
    met = None if worst is None else worst >= limit
    return Target(what=what, unit=unit, measured=worst, bound="at least", limit=limit, met=met)


class Report(Record):
    """One bench. In JSON the version stands under ``schema``."""

    version: Literal[1] = Field(default=1, alias="schema")
    complete: bool
    """Whether everything that was wanted has been measured."""
    duration_s: float
    machine: Machine
    settings: Settings
    targets: tuple[Target, ...]
    figures: Figures

    def to_json(self) -> str:
        """The report as one JSON object."""
        return self.model_dump_json(by_alias=True, indent=2)

    def show(self, console: Console) -> None:
        """Print it as tables, last the targets of which there are figures."""
        machine, libraries = self.machine, self.machine.libraries.items()
        commit = f" ({machine.commit})" if machine.commit else ""
        console.print(
            f"unspoken {machine.version}{commit} on {machine.cpu}, {machine.cores} cores, "
            f"{machine.memory_mib / 1024.0:.0f} GiB, load {machine.load_1min:.1f} at the beginning\n"
            f"{machine.system}, Python {machine.python}, "
            + ", ".join(f"{name} {version}" for name, version in libraries),
            markup=False,
            soft_wrap=True,
        )
        for name in SECTIONS:
            if rows := getattr(self.figures, name):
                console.print(table(rows))
        targets = new_table("Targets", "What", "Measured", "Target", "Met")
        for target in self.targets:
            if target.measured is not None:
                limit = f"{'≤' if target.bound == 'at most' else '≥'} {target.limit:g} {target.unit}"
                met = "[green]yes[/]" if target.met else "[red]no[/]"
                targets.add_row(target.what, number(target.measured), limit, met)
        if targets.row_count:
            console.print(targets)
        ended = "measured" if self.complete else "[red]INCOMPLETE[/]: ended"
        console.print(f"{ended} in {self.duration_s:.0f} s")


class Bench:
    """A bench that goes on: there is a report of it at any time.

    Args:
        settings: what to measure.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._machine = this_machine()
        self._begin_s = time.monotonic()
        self._rows: defaultdict[SectionName, list[Row]] = defaultdict(list)
        self._complete = False

    def measure(self, progress: Progress) -> None:
        """Measure everything.

        Raises:
            KeyboardInterrupt: it is to end.
            Refusal: a process ended when it should not have, or the solver cannot be compiled.
        """
        progress.begin(announced("measuring"))
        compile_solver(progress.interruption)
        warm_up("ioc", "realtime")
        for name in self._settings.sections:
            for row in SECTIONS[name].measure(self._settings, progress):
                self._rows[name].append(row)
        self._complete = True

    def report(self) -> Report:
        """What has been measured so far."""
        figures = Figures.model_validate({name: tuple(rows) for name, rows in self._rows.items()})
        return Report(
            complete=self._complete,
            duration_s=time.monotonic() - self._begin_s,
            machine=self._machine,
            settings=self._settings,
            targets=judge(figures),
            figures=figures,
        )
