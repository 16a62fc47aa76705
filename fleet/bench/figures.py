"""The sections of a bench, side by side."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from rich.table import Table

from fleet.bench import bus, comparison, compiling, decision, prediction, runs, startup
from fleet.bench.bus import BusRow
from fleet.bench.comparison import ComparisonRow
from fleet.bench.compiling import CompilingRow
from fleet.bench.decision import DecisionRow
from fleet.bench.prediction import PredictionRow
from fleet.bench.runs import RunRow
from fleet.bench.settings import SectionName, Settings
from fleet.bench.startup import StartupRow
from fleet.bench.watch import Watch
from fleet.record.report_file import Record


class Figures(Record):
    """Rows by section; a section that was not measured has none."""

    prediction: tuple[PredictionRow, ...] = ()
    comparison: tuple[ComparisonRow, ...] = ()
    decision: tuple[DecisionRow, ...] = ()
    bus: tuple[BusRow, ...] = ()
    runs: tuple[RunRow, ...] = ()
    startup: tuple[StartupRow, ...] = ()
    compiling: tuple[CompilingRow, ...] = ()


@dataclass(frozen=True)
class Section:
    """How a section is measured, row by row, and shown."""

    measure: Callable[[Settings, Watch], Iterator[Record]]
    table: Callable[[Any], Table]


SECTIONS: dict[SectionName, Section] = {
    SectionName.PREDICTION: Section(prediction.measure, prediction.table),
    SectionName.COMPARISON: Section(comparison.measure, comparison.table),
    SectionName.DECISION: Section(decision.measure, decision.table),
    SectionName.BUS: Section(bus.measure, bus.table),
    SectionName.RUNS: Section(runs.measure, runs.table),
    SectionName.STARTUP: Section(startup.measure, startup.table),
    SectionName.COMPILING: Section(compiling.measure, compiling.table),
}
