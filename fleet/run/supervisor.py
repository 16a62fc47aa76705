"""Which of a run's processes have ended, whether that was to be, and whether they are started again."""

import time
from collections import Counter
from collections.abc import Callable
from enum import StrEnum

import structlog

from chassis.refusal import ExitStatus
from fleet.inject.process_faults import WORLD
from fleet.run.processes import Processes

BACK_OFF_S = (0.5, 1.0, 2.0, 4.0, 8.0)
"""How long after its end a process is started again, the first time and each further time; then no more."""

log = structlog.get_logger("bench")


class Restart(StrEnum):
    """Which processes are started again."""

    NEVER = "never"
    ON_FAILURE = "on-failure"


class Supervisor:
    """Looks after the processes of a processes.

    Args:
        processes: whose processes they are.
        restart: which of them are started again.
        now_s: a monotonic clock.
    """

    def __init__(
        self,
        processes: Processes,
        restart: Restart = Restart.NEVER,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._processes = processes
        self._restart = restart
        self._now_s = now_s
        self._due_s: dict[str, float] = {}
        self._attempts: Counter[str] = Counter()
        self._excused: set[str] = set()
        self.lost: dict[str, str] = {}
        """Who has ended and is not started again, with how it ended and what it said last."""

    def excuse(self, name: str) -> None:
        """The end of this process is wanted: it is neither lost nor started again by this."""
        self._excused.add(name)

    def expect(self, name: str) -> None:
        """This process is to run from now on."""
        self._excused.discard(name)

    def give_up_restarting(self) -> None:
        """The run is about to end: start nothing more."""
        self._restart = Restart.NEVER
        self._due_s.clear()

    def look(self) -> None:
        """Note who has ended, and start again whose time has come."""
        for name, status in self._processes.statuses().items():
            if name in self._excused or name in self.lost:
                continue
            if name in self._due_s:
                self._start_if_due(name)
            elif self._is_to_return(name, status):
                pause_s = BACK_OFF_S[self._attempts[name]]
                self._due_s[name] = self._now_s() + pause_s
                log.warning("ended, and is to be started again", process=name, status=status, in_s=pause_s)
            else:
                self.lost[name] = self._processes.account(name)

    def _is_to_return(self, name: str, status: int) -> bool:
        over = name == WORLD and status in (ExitStatus.DONE, ExitStatus.UNMET)
        return self._restart is Restart.ON_FAILURE and not over and self._attempts[name] < len(BACK_OFF_S)

    def _start_if_due(self, name: str) -> None:
        if self._now_s() < self._due_s[name]:
            return
        del self._due_s[name]
        self._attempts[name] += 1
        self._processes.start_again(name)
        log.warning("started again", process=name, attempt=self._attempts[name])
