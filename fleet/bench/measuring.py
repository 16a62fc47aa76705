"""Measures the sections that are wanted, one after the other."""

import time
from collections import defaultdict

from agent.process.warm import warm_up
from fleet.bench.figures import SECTIONS, Figures
from fleet.bench.report import Report
from fleet.bench.settings import SectionName, Settings
from fleet.bench.targets import judge
from fleet.bench.watch import Watch
from fleet.record.machine import this_machine
from fleet.record.report_file import Record
from fleet.run.progress import announced, compile_solver


class Measuring:
    """A bench while it goes on: there is a report of it at any time.

    Args:
        settings: what to measure.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._machine = this_machine()
        self._begin_s = time.monotonic()
        self._rows: defaultdict[SectionName, list[Record]] = defaultdict(list)
        self._complete = False

    def go(self, watch: Watch) -> None:
        """Measure everything.

        Raises:
            KeyboardInterrupt: the watch ends it.
            ProcessFailedError: a process ended when it should not have, or the solver cannot be compiled.
        """
        watch.tell(announced("measuring"))
        compile_solver(watch.interruption)
        warm_up("ioc", "realtime")
        for name in self._settings.sections:
            for row in SECTIONS[name].measure(self._settings, watch):
                self._rows[name].append(row)
        self._complete = True

    def report(self) -> Report:
        """What has been measured so far."""
        figures = Figures.model_validate(self._rows)
        return Report(
            complete=self._complete,
            duration_s=time.monotonic() - self._begin_s,
            machine=self._machine,
            settings=self._settings,
            targets=judge(figures),
            figures=figures,
        )
