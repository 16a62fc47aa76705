"""Robots' processes that this process has started, and what they take."""

from contextlib import suppress
from typing import NamedTuple

import psutil

from fleet.record.machine import MIB


class Taken(NamedTuple):
    """What a process has taken so far."""

    resident_mib: float
    cpu_s: float


def agents() -> list[psutil.Process]:
    """The processes ``python -m agent`` among our children, the oldest first."""
    children = sorted(psutil.Process().children(), key=lambda child: child.create_time())
    return [child for child in children if _module(child) == "agent"]


def taken_by(process: psutil.Process) -> Taken | None:
    """What a process has taken; None if it has ended."""
    with suppress(psutil.NoSuchProcess):
        times = process.cpu_times()
        return Taken(process.memory_info().rss / MIB, times.user + times.system)
    return None


def _module(process: psutil.Process) -> str | None:
    """What a Python process was started to run with ``-m``."""
    with suppress(psutil.NoSuchProcess, psutil.ZombieProcess):
        words = process.cmdline()
        return words[words.index("-m") + 1] if "-m" in words[:-1] else None
    return None
