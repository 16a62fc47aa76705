"""The machine and the software that were measured."""

import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

import psutil

from fleet.record.report_file import Record

MIB = 2.0**20
LIBRARIES = ("numpy", "numba", "casadi", "eclipse-zenoh", "pydantic")


class Machine(Record):
    """What figures depend on besides the code."""

    cpu: str
    cores: int
    """That this process may use."""
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
        cores=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
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
    try:
        said = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--dirty=+", "--exclude=*"],
            check=True,
            capture_output=True,
            text=True,
            timeout=10.0,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return said.stdout.strip()
