"""What a hunt has found: the scenarios that hurt most, as files, and a file with the results."""

import math
import shlex
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from pydantic import Field

from agent.estimate import GoalsName
from chassis.files import Record, empty_directory, write_whole
from chassis.refusal import ExitStatus, Refusal
from fleet.hunt.attempt import ENOUGH, Attempt, Harm, Outcome, Points
from fleet.inject.scenario import Scenario, warnings_of
from fleet.record.report import Machine
from fleet.scenarios.wild import WildName, scenario_at
from protocol.scenario import scenario_text

RESULTS = "results.json"
Kind = Literal["distance", "deadlock", "time", "failed"]
"""Of what is kept: a harm, or an exception."""


class Settings(Record):
    """What is hunted for, and where."""

    family: WildName
    robots: tuple[int, ...]
    harms: tuple[Harm, ...]
    goals: GoalsName
    seed: int
    runs: int
    """To be made."""
    keep: int
    """Scenarios of each kind of harm to be kept."""


class Find(Record):
    """A scenario that hurts, with what came of it."""

    file: str
    harm: Kind
    robots: int
    outcome: Outcome
    command: str
    """What repeats it."""
    warnings: tuple[str, ...]
    """Why the scenario cannot be safe; empty where it can."""


class Results(Record):
    """The file of results. In JSON the version stands under ``schema``."""

    version: Literal[1] = Field(default=1, alias="schema")
    settings: Settings
    machine: Machine
    begun: datetime
    made: int
    """Runs."""
    contacts: int
    """Runs in which robots touched."""
    not_arrived: int
    """Runs in which not all robots arrived."""
    failed: int
    """Runs that ended with an exception."""
    finds: tuple[Find, ...]


class _Kept(NamedTuple):
    """In the order of harm: the lowest value first, and of equal ones the one that was tried first."""

    value: float
    number: int
    outcome: Outcome
    scenario: Scenario


class Finds:
    """Takes the outcomes of a hunt and keeps the scenarios that hurt most in a directory.

    Of one start of the search only the worst is kept, since the others are much like it. Harm that a run does
    counts whether the search looked for it or not: contact and robots that never arrive are kept in any case.

    Raises:
        Refusal: the directory cannot be made, or holds something.
    """

    def __init__(self, directory: Path, settings: Settings, machine: Machine, begun: datetime) -> None:
        empty_directory(directory)
        self.directory = directory
        self._settings, self._machine, self._begun = settings, machine, begun
        self._wanted = {
            harm: math.inf if harm in settings.harms else enough for harm, enough in ENOUGH.items()
        }
        """Values below this are kept."""
        self._kept: dict[Kind, dict[tuple[Harm, int, int], _Kept]] = {kind: {} for kind in get_args(Kind)}
        """And then by what was looked for, number of robots and start of the search."""
        self._tried: list[Attempt] = []
        self._outcomes: list[Outcome] = []

    def attempts(self, points: Points, harm: Harm, robots: int, start: int) -> list[Attempt]:
        """The next runs, at points from one start of the search."""
        goals, seed, first = self._settings.goals, self._settings.seed, len(self._tried)
        new = [
            Attempt(first + index, harm, start, scenario_at(point, robots), goals, seed)
            for index, point in enumerate(points)
        ]
        self._tried += new
        return new

    def add(self, outcome: Outcome) -> None:
        """Take in what came of a run."""
        self._outcomes.append(outcome)
        tried = self._tried[outcome.number]
        kinds: list[Kind] = [harm for harm in ENOUGH if outcome.value(harm) < self._wanted[harm]]
        if outcome.failed:
            kinds = ["failed"]
        origin = tried.harm, len(tried.scenario.robots), tried.start
        for kind in kinds:
            value = 0.0 if kind == "failed" else outcome.value(kind)
            kept, best = _Kept(value, tried.number, outcome, tried.scenario), self._kept[kind]
            best[origin] = min(best.get(origin, kept), kept, key=lambda each: each[:2])

    def worst(self, harm: Harm) -> Outcome | None:
        """The outcome that hurts most so far."""
        kept = self._kept[harm]
        return min(kept.values(), key=lambda each: each[:2]).outcome if kept else None

    def results(self) -> Results:
        """Everything so far."""
        return Results(
            settings=self._settings,
            machine=self._machine,
            begun=self._begun,
            made=len(self._outcomes),
            contacts=sum(each.touched for each in self._outcomes),
            not_arrived=sum(each.missing > 0 for each in self._outcomes),
            failed=sum(each.failed for each in self._outcomes),
            finds=tuple(find for find, _ in self._finds()),
        )

    def write(self) -> Results:
        """Write everything so far.

        Raises:
            Refusal: the disk does not take it.
        """
        results = self.results()
        try:
            for find, scenario in self._finds():
                named = scenario.model_copy(update={"name": Path(find.file).stem})
                comment = f"# Found by unspoken hunt; to repeat it: {find.command}\n"
                write_whole(self.directory / find.file, comment + scenario_text(named))
            write_whole(self.directory / RESULTS, results.model_dump_json(by_alias=True, indent=2) + "\n")
        except OSError as error:
            where = error.filename or self.directory
            raise Refusal(f"{where}: cannot be written: {error.strerror}", ExitStatus.FAILED) from error
        return results

    def _finds(self) -> Iterator[tuple[Find, Scenario]]:
        """What is kept, kind by kind, the worst first."""
        for harm, starts in self._kept.items():
            worst = sorted(starts.values(), key=lambda each: each[:2])[: self._settings.keep]
            for rank, kept in enumerate(worst, 1):
                file = f"{harm}-{rank}.yaml"
                options = f"--goals {self._settings.goals} --seed {self._settings.seed}"
                find = Find(
                    file=file,
                    harm=harm,
                    robots=len(kept.scenario.robots),
                    outcome=kept.outcome,
                    command=f"unspoken simulate {shlex.quote(str(self.directory / file))} {options}",
                    warnings=tuple(warnings_of(kept.scenario)),
                )
                yield find, kept.scenario
