"""What reports of several runs share: JSON, tables, the bar that shows the progress, and the machine."""

import os
import platform
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Final

import psutil
import typer
from rich import box
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from chassis.files import Record
from chassis.refusal import ExitStatus, Refusal

TO_STDOUT: Final = Path("-")
SPEED_S = 600.0
"""The time left is judged by what was done in so many seconds: runs differ much."""
MIB = 2.0**20
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""That this process may use."""
LIBRARIES = ("numpy", "numba", "casadi", "eclipse-zenoh", "pydantic")

JsonOption = Annotated[
    Path | None,
    typer.Option(
        help="Write the report to this file as JSON; - writes it to standard output, and the tables to "
        "standard error.",
        dir_okay=False,
        allow_dash=True,
    ),
]


def write_report(text: str, path: Path, status: ExitStatus = ExitStatus.FAILED) -> None:
    """Write a report into a file, or to the standard output where the path is ``-``.

    Raises:
        Refusal: it cannot be written there; with the given status.
    """
    if path == TO_STDOUT:
        sys.stdout.write(text + "\n")
        return
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise Refusal(
            f"{path}: the report cannot be written there: {error.strerror}; "
            "a file in a directory that exists and can be written is expected in --json",
            status,
        ) from None


def new_table(title: str, *headers: str, names: int = 1) -> Table:
    """An empty table: columns of names first, then columns of numbers; a row is never broken."""
    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
    )
    for index, header in enumerate(headers):
        table.add_column(header, justify="left" if index < names else "right", no_wrap=True)
    return table


def number(value: float | None) -> str:
    """A number with the digits that matter; a dash for none."""
    if value is None:
        return "–"
    if value == 0.0:
        return "0"
    if abs(value) < 0.01:
        return f"{value:.0e}"
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def progress_of_many(console: Console) -> Progress:
    """A bar with the time left; its tasks have a field ``failed``, a text."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failed]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        speed_estimate_period=SPEED_S,
    )


class Machine(Record):
    """The machine and the software that were measured: what figures depend on besides the code."""

    cpu: str
    cores: int
    """``CORES``."""
    memory_mib: float
    load_1min: float
    """Processes that wanted a core in the minute before the bench began."""
    system: str
    python: str
    version: str
    """Of this software."""
    commit: str | None
    """Of the sources, with ``+`` where they were changed since; None outside a git checkout."""
    libraries: dict[str, str]
    """Their versions."""


def this_machine() -> Machine:
    """As it is now."""
    return Machine(
        cpu=_cpu(),
        cores=CORES,
        memory_mib=psutil.virtual_memory().total / MIB,
        load_1min=os.getloadavg()[0],
        system=platform.platform(),
        python=platform.python_version(),
        version=version("unspoken"),
        commit=_commit(),
        libraries={name: version(name) for name in LIBRARIES},
    )


def _cpu() -> str:
    """The processor's name; on Linux only the kernel tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _commit() -> str | None:
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return None
    command = ["git", "-C", str(root), "describe", "--always", "--dirty=+", "--exclude=*"]
    try:
        return subprocess.check_output(command, stderr=subprocess.DEVNULL, text=True, timeout=10.0).strip()
    except (OSError, subprocess.SubprocessError):
        return None
