"""What ``unspoken bench`` found out. Its JSON is a contract, described in docs/performance.md."""

from typing import Literal

from pydantic import Field
from rich.console import Console

from fleet.bench import targets
from fleet.bench.figures import SECTIONS, Figures
from fleet.bench.settings import Settings
from fleet.bench.targets import Target
from fleet.record.machine import Machine
from fleet.record.report_file import Record


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


def show(report: Report, console: Console) -> None:
    """Print a report as tables, the targets last."""
    machine, libraries = report.machine, report.machine.libraries.items()
    commit = f" ({machine.commit})" if machine.commit else ""
    console.print(
        f"unspoken {machine.version}{commit} on {machine.cpu}, {machine.cores} cores, "
        f"{machine.memory_mib / 1024.0:.0f} GiB, load {machine.load_1min:.1f} at the beginning\n"
        f"{machine.system}, Python {machine.python}, "
        + ", ".join(f"{name} {version}" for name, version in libraries),
        markup=False,
        soft_wrap=True,
    )
    for name, section in SECTIONS.items():
        if rows := getattr(report.figures, name):
            console.print(section.table(rows))
    console.print(targets.table(report.targets))
    ended = "measured" if report.complete else "[red]INCOMPLETE[/]: ended"
    console.print(f"{ended} in {report.duration_s:.0f} s")
