"""Makes the processes of a run fail as its faults say: kills them, stops them, starts them again."""

import os
import signal
import time
from collections.abc import Callable
from typing import Any

import structlog

from fleet.inject.schedule import Scheduled, schedule
from fleet.run.experiment import Experiment
from fleet.run.launch import name_of
from fleet.run.processes import Processes
from fleet.run.supervisor import WORLD, Supervisor
from protocol.faults import Freeze, Kill, Pause, RecorderDies, RestartWorld
from protocol.messages import Truth

log = structlog.get_logger("faults")

OF_ROBOTS = (Kill, Freeze)
OF_ALL = (RestartWorld, Pause, RecorderDies)


class Director:
    """Follows the steps of a run and acts on its processes.

    It counts steps since the first start of the world, and knows of one when its truth reaches the bench; in
    lock-step the world may be a step or two ahead. Whom it kills is not taken for failed. A new epoch begins
    with all robots, since the world waits for them; whoever is to be down then is killed again.

    Args:
        experiment: whose faults these are.
        processes: the processes.
        supervisor: is told whose end is wanted.
        now_s: a monotonic clock.
    """

    def __init__(
        self,
        experiment: Experiment,
        processes: Processes,
        supervisor: Supervisor,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        scenario = experiment.scenario
        self._processes, self._supervisor, self._now_s = processes, supervisor, now_s
        faults = schedule(scenario.faults, seed=experiment.facts.seed, step_s=scenario.step_s)
        self._of_robots: list[Scheduled[Any]] = [each for each in faults if isinstance(each.fault, OF_ROBOTS)]
        self._of_all: list[Scheduled[Any]] = [each for each in faults if isinstance(each.fault, OF_ALL)]
        self._killed: set[str] = set()
        self._frozen: set[str] = set()
        self._steps_before = 0
        self._step = 0
        self._due: list[tuple[float, Callable[[], None]]] = []

    def at(self, truth: Truth) -> None:
        """The world has come to this step."""
        self._step = self._steps_before + truth.step
        for each in [each for each in self._of_all if each.begin <= self._step]:
            self._of_all.remove(each)
            self._strike_all(each.fault)
        self._set_killed(self._befallen(Kill))
        self._set_frozen(self._befallen(Freeze))

    def look(self) -> None:
        """Do what is due by the wall clock."""
        now_s = self._now_s()
        due = [act for due_s, act in self._due if due_s <= now_s]
        self._due = [each for each in self._due if each[0] > now_s]
        for act in due:
            act()

    def world_started_again(self) -> None:
        """A new epoch begins, with all robots."""
        self._steps_before = self._step + 1
        self._set_killed(set())
        self._set_frozen(set())

    def _befallen(self, kind: type[Kill | Freeze]) -> set[str]:
        return {
            name_of(robot)
            for each in self._of_robots
            if isinstance(each.fault, kind) and each.is_on(self._step)
            for robot in each.fault.robots
        }

    def _set_killed(self, wanted: set[str]) -> None:
        for name in wanted - self._killed:
            self._kill(name)
        for name in self._killed - wanted:
            self._start_again(name)
        self._killed = wanted

    def _set_frozen(self, wanted: set[str]) -> None:
        for name in wanted - self._frozen:
            log.warning("stopped by a fault", process=name)
            self._processes.signal(name, signal.SIGSTOP)
        thawed, self._frozen = self._frozen - wanted, wanted
        for name in thawed:
            log.warning("goes on", process=name)
            self._processes.signal(name, signal.SIGCONT)

    def _strike_all(self, fault: RestartWorld | Pause | RecorderDies) -> None:
        match fault:
            case RestartWorld():
                self._kill(WORLD)
                self._later(fault.duration_s, lambda: self._start_again(WORLD))
            case Pause():
                log.warning("everything stopped by a fault", for_s=fault.duration_s)
                self._signal_all(signal.SIGSTOP)
                self._later(fault.duration_s, lambda: self._signal_all(signal.SIGCONT))
            case RecorderDies():
                os.kill(os.getpid(), signal.SIGKILL)

    def _later(self, delay_s: float, act: Callable[[], None]) -> None:
        self._due.append((self._now_s() + delay_s, act))

    def _kill(self, name: str) -> None:
        log.warning("killed by a fault", process=name)
        self._supervisor.excuse(name)
        self._processes.signal(name, signal.SIGKILL)

    def _start_again(self, name: str) -> None:
        log.warning("started again after a fault", process=name)
        self._supervisor.expect(name)
        self._processes.start_again(name)

    def _signal_all(self, number: signal.Signals) -> None:
        for name in self._processes.names():
            if name not in self._frozen:
                self._processes.signal(name, number)
