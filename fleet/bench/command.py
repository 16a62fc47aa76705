"""``unspoken bench``: its command line, its report, and the targets that its figures are held against.

The report's JSON is a contract, described in docs/performance.md.
"""

import time
from collections import defaultdict
from collections.abc import Sequence
from functools import partial
from typing import Annotated, Literal, get_args

import typer
from pydantic import Field
from rich.console import Console
from rich.progress import Progress as Bar
from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from agent.process.warm import warm_up
from chassis.files import Record
from chassis.options import with_options
from chassis.refusal import ExitStatus, Refusal
from fleet.bench.decisions import ComparisonRow, DecisionRow, PredictionRow
from fleet.bench.measuring import MOST_ROBOTS, Progress, Row, SectionName, Settings
from fleet.bench.processes import BusRow, CompilingRow, RunRow, StartupRow
from fleet.interruption import Interruption, announced, compile_solver
from fleet.record.report import (
    TO_STDOUT,
    JsonOption,
    Machine,
    new_table,
    number,
    this_machine,
    write_report,
)

WIDTH = 120
"""What the widest table needs."""
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


SECTIONS: dict[SectionName, type[Row]] = {
    name: get_args(Figures.model_fields[name].annotation)[0] for name in SectionName
}


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
    per_second = [r.steps_per_s for r in runs if r.clock == "lockstep"]
    decision, crossings = "whole decision, 8a, CPU time", "random crossings of 8"
    rivals, faster = "joint prediction, 8a, against the reference", "times faster"
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
        _least("8a in lock-step", 10.0, "steps a second", per_second),
        _most("8a in real time, deadline misses", 1.0, "%", [r.deadline_misses_percent for r in real]),
        _most("8a in real time, collisions", 0.0, "pairs", [r.collisions for r in real]),
        _most("8a in real time, not arrived", 0.0, "robots", [r.not_arrived for r in real]),
        _most("an agent's process, resident", 250.0, "MiB", [r.agent_resident_mib for r in runs]),
        _most(ready, 3.0, "s", [r.ready_s for r in figures.startup if r.together == 1]),
        _most(compiling, 60.0, "s", [r.cpu_s for r in figures.compiling if r.cache == "empty"]),
    )


def _target(
    bound: Literal["at most", "at least"], what: str, limit: float, unit: str, values: Sequence[float]
) -> Target:
    worst = max(values, default=None) if bound == "at most" else min(values, default=None)
    met = None if worst is None else worst <= limit if bound == "at most" else worst >= limit
    return Target(what=what, unit=unit, measured=worst, bound=bound, limit=limit, met=met)


_most, _least = partial(_target, "at most"), partial(_target, "at least")


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
                console.print(_table(rows))
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


def _table(rows: Sequence[Row]) -> Table:
    """The table of a section that has rows."""
    result = new_table(rows[0].title, *rows[0].headers.split("|"), names=rows[0].names)
    for row in rows:
        for line in row.lines():
            result.add_row(*(cell if isinstance(cell, str) else number(cell) for cell in line))
        if row.names > 1:
            result.add_section()
    return result


def _numbers(text: str) -> str:
    numbers = [int(part) if part.isdecimal() else 0 for part in text.split(",")]
    if not all(2 <= number <= MOST_ROBOTS for number in numbers):
        raise typer.BadParameter(
            f"{text!r} found, whole numbers from 2 to {MOST_ROBOTS} with commas between are expected, "
            "such as 2,8"
        )
    return text


@with_options(without=("sections", "robots"))
def bench(
    *,
    only: Annotated[
        list[SectionName] | None,
        typer.Option(help="Measure only this section; can be repeated.", show_default="all"),
    ] = None,
    robots: Annotated[
        str, typer.Option(callback=_numbers, help="Numbers of robots to measure with.", metavar="N,N,…")
    ] = ",".join(map(str, Settings().robots)),
    options: Settings,
    json: JsonOption = None,
) -> None:
    """Measure the speed and quality of decisions on this machine: solver, decisions, bus and processes.

    Takes minutes; Ctrl-C ends it with the results so far. docs/performance.md explains it.

    Exit status: 0 everything was measured, whether targets are met or not; 1 interrupted, and the report is
    marked as incomplete; 2 invalid usage; 3 a process failed or the report cannot be written.
    """
    sections = tuple(name for name in SECTIONS if only is None or name in only)
    numbers = tuple(sorted({int(part) for part in robots.split(",")}))
    settings = options.model_copy(update={"sections": sections, "robots": numbers})
    machine, begin_s = this_machine(), time.monotonic()
    rows: defaultdict[SectionName, list[Row]] = defaultdict(list)

    def report(*, complete: bool) -> Report:
        figures = Figures.model_validate({name: tuple(each) for name, each in rows.items()})
        return Report(
            complete=complete,
            duration_s=time.monotonic() - begin_s,
            machine=machine,
            settings=settings,
            targets=judge(figures),
            figures=figures,
        )

    if json not in (None, TO_STDOUT):  # a mistake in the path is told now, not after minutes
        write_report(report(complete=False).to_json(), json, ExitStatus.WRONG_USAGE)
    failure: KeyboardInterrupt | Refusal | None = None
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    with Interruption() as interruption, Bar(*columns, console=_console(stderr=True), transient=True) as bar:
        line = bar.add_task("", total=None)
        progress = Progress(interruption, lambda work: bar.update(line, description=work))
        try:
            progress.begin(announced("measuring"))
            compile_solver(interruption)
            warm_up("ioc", "realtime")
            for name in sections:
                for row in SECTIONS[name].measure(settings, progress):
                    rows[name].append(row)
        except (KeyboardInterrupt, Refusal) as error:  # what was measured before is reported first
            failure = error
    made = report(complete=failure is None)
    made.show(_console(stderr=json == TO_STDOUT))
    if json is not None:
        write_report(made.to_json(), json)
    if isinstance(failure, Refusal):
        raise failure
    if failure is not None:
        raise typer.Exit(ExitStatus.UNMET)


def _console(*, stderr: bool) -> Console:
    """One whose tables are never cut: on a narrow terminal their lines go on in the next one."""
    width = max(Console(stderr=stderr).width, WIDTH)
    return Console(stderr=stderr, highlight=False, width=width)
