"""Kinds of faults of whole robots, processes and the recording, and what makes processes fail so."""

import errno
import io
import math
import os
import signal
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Protocol

from pydantic import Field

from chassis.lean import structlog
from chassis.refusal import ExitStatus
from fleet.inject.fault import Fault, NamedRobotFault, of_kind, schedule
from protocol.messages import Truth
from protocol.scenario import Scenario

WORLD = "world"
"""The name of its process."""
RealSeconds = Annotated[float, Field(gt=0, le=60)]

log = structlog.get_logger("faults")


def name_of(robot: str) -> str:
    """The process of a robot."""
    return f"robot-{robot}"


class DownFault(NamedRobotFault):
    """The robot's process does nothing meanwhile."""

    forgets: ClassVar[bool]
    """Whether it begins anew after it."""


class Kill(DownFault):
    """The robot's process is killed; with a duration it is started again after it, otherwise never."""

    kind: Literal["kill"]
    forgets = True


class Freeze(DownFault):
    """The robot's process is stopped, and goes on after the duration."""

    kind: Literal["freeze"]
    forgets = False


class AbsenceFault(NamedRobotFault):
    """The robot is not in the scene: nobody sees it or can meet it."""

    def absence_s(self, begin_s: float, end_s: float) -> tuple[float, float]:
        """From when to when, given the time of the fault."""
        return begin_s, end_s


class ArrivesLate(AbsenceFault):
    """The robot is not there before; it has no duration."""

    kind: Literal["arrives-late"]

    def absence_s(self, begin_s: float, _end_s: float) -> tuple[float, float]:
        return 0.0, begin_s


class Leaves(AbsenceFault):
    """The robot is gone from then on; with a duration it comes back where it left."""

    kind: Literal["leaves"]


class MachineFault(Fault):
    """Strikes all processes once, when its time has come."""

    def strike(self, processes: "ProcessFaults") -> None:
        raise NotImplementedError


class RestartWorld(MachineFault):
    """The world's process is killed, and started again after the duration, from step 0 in a new epoch."""

    kind: Literal["restart-world"]
    duration_s: RealSeconds = 1.0

    def strike(self, processes: "ProcessFaults") -> None:
        processes.kill(WORLD)
        processes.later(self.duration_s, lambda: processes.start_again(WORLD))


class Pause(MachineFault):
    """The whole machine stands still for the duration, counted in real time."""

    kind: Literal["pause"]
    duration_s: RealSeconds = 1.0
    needs_processes = True

    def strike(self, processes: "ProcessFaults") -> None:
        processes.signal_all(signal.SIGSTOP)
        processes.later(self.duration_s, lambda: processes.signal_all(signal.SIGCONT))


class RecorderDies(MachineFault):
    """The bench, which records, is killed."""

    kind: Literal["recorder-dies"]
    needs_processes = True
    exit_status = -signal.SIGKILL

    def strike(self, _processes: "ProcessFaults") -> None:
        os.kill(os.getpid(), signal.SIGKILL)


class DiskFull(Fault):
    """The disk takes nothing more of the recording."""

    kind: Literal["disk-full"]
    needs_processes = True
    exit_status = ExitStatus.FAILED


class FullDisk:
    """Opens the file of a recording, and refuses to write to it once the disk is to be full.

    Args:
        faults: of the run; those of the disk count.
        seed: of the run.
        step_s: Δt in s.
    """

    def __init__(self, faults: Sequence[Fault], *, seed: int, step_s: float) -> None:
        scheduled = of_kind(schedule(faults, seed=seed, step_s=step_s), DiskFull)
        self._begin = min((each.begin for each in scheduled), default=math.inf)
        self.is_full = False

    def at(self, step: int) -> None:
        """The run has come to this step; a world that starts again does not empty the disk."""
        self.is_full = self.is_full or self._begin <= step

    def open(self, path: Path) -> io.BufferedWriter:
        """The file, empty.

        Raises:
            OSError: it cannot be opened.
        """
        return io.BufferedWriter(_File(path, self))


class _File(io.FileIO):
    def __init__(self, path: Path, disk: FullDisk) -> None:
        super().__init__(path, "wb")
        self._disk = disk

    def write(self, data: object, /) -> int:
        if self._disk.is_full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)  # type: ignore[arg-type]  # a buffer, which typing names from 3.12 on


class Processes(Protocol):
    """Of a run; see :class:`fleet.run.processes.Processes`, which this room does not know."""

    def names(self) -> Iterable[str]: ...
    def signal(self, name: str, number: signal.Signals, /) -> None: ...
    def start_again(self, name: str, /) -> None: ...


class Supervisor(Protocol):
    """Looks after them; see :class:`fleet.run.supervisor.Supervisor`."""

    def excuse(self, name: str, /) -> None: ...
    def expect(self, name: str, /) -> None: ...


class ProcessFaults:
    """Follows the steps of a run and makes its processes fail as its faults say.

    It counts steps since the first start of the world, and knows of one when its truth reaches the bench; in
    lock-step the world may be a step or two ahead. Whom it kills is not taken for failed. A new epoch begins
    with all robots, since the world waits for them; whoever is to be down then is killed again.

    Args:
        scenario: with its faults.
        seed: of the run.
        processes: of the run.
        supervisor: is told whose end is wanted.
    """

    def __init__(self, scenario: Scenario, seed: int, processes: Processes, supervisor: Supervisor) -> None:
        self._processes, self._supervisor = processes, supervisor
        faults = schedule(scenario.faults, seed=seed, step_s=scenario.step_s)
        self._down_faults = of_kind(faults, DownFault)
        self._machine_faults = of_kind(faults, MachineFault)
        self._killed: set[str] = set()
        self._frozen: set[str] = set()
        self._steps_before = 0
        self._step = 0
        self._due: list[tuple[float, Callable[[], None]]] = []

    def at(self, truth: Truth) -> None:
        """The world has come to this step."""
        self._step = self._steps_before + truth.step
        for each in [each for each in self._machine_faults if each.begin <= self._step]:
            self._machine_faults.remove(each)
            log.warning("a fault of all processes", kind=each.fault.kind, for_s=each.fault.duration_s)
            each.fault.strike(self)
        down = [each.fault for each in self._down_faults if each.is_on(self._step)]
        killed, frozen = (
            {name_of(robot) for fault in down if fault.forgets is forgets for robot in fault.robots}
            for forgets in (True, False)
        )
        self._set_down(killed, frozen)

    def look(self) -> None:
        """Do what is due by the wall clock."""
        now_s = time.monotonic()
        due = [act for due_s, act in self._due if due_s <= now_s]
        self._due = [each for each in self._due if each[0] > now_s]
        for act in due:
            act()

    def world_started_again(self) -> None:
        """A new epoch begins, with all robots."""
        self._steps_before = self._step + 1
        self._set_down(set(), set())

    def kill(self, name: str) -> None:
        """End a process at once, which is no failure of the run."""
        log.warning("killed by a fault", process=name)
        self._supervisor.excuse(name)
        self._processes.signal(name, signal.SIGKILL)

    def start_again(self, name: str) -> None:
        """Start a process that was killed."""
        log.warning("started again after a fault", process=name)
        self._supervisor.expect(name)
        self._processes.start_again(name)

    def signal_all(self, number: signal.Signals) -> None:
        """Send a signal to all processes but the bench, and those that are stopped already."""
        for name in self._processes.names():
            if name not in self._frozen:
                self._processes.signal(name, number)

    def later(self, delay_s: float, act: Callable[[], None]) -> None:
        """Do something after a delay in real time."""
        self._due.append((time.monotonic() + delay_s, act))

    def _set_down(self, killed: set[str], frozen: set[str]) -> None:
        """Let these processes be killed or stopped, and no others."""
        for name in killed - self._killed:
            self.kill(name)
        for name in self._killed - killed:
            self.start_again(name)
        for name in frozen - self._frozen:
            log.warning("stopped by a fault", process=name)
            self._processes.signal(name, signal.SIGSTOP)
        for name in self._frozen - frozen:
            log.warning("goes on", process=name)
            self._processes.signal(name, signal.SIGCONT)
        self._killed, self._frozen = killed, frozen
