"""What the repetition of a whole run shows. Its JSON is a contract, described in docs/auditing.md."""

import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Literal

from pydantic import Field

from fleet.audit.difference import Difference, Part
from fleet.audit.recorded import RecordedRun
from fleet.audit.replay import RobotReplay, Tally, WorldReplay
from fleet.record.report_file import Record
from fleet.run.experiment import RunFacts
from protocol.messages import Verdict

Watch = Callable[[str, int, int], None]
"""Told of a robot how many decisions are done, and how many there are. May raise KeyboardInterrupt."""

PARTS: tuple[Part, ...] = ("key", "scene", "truth", "observation", "mind", "command")
"""In this order differences of one step are told: what is given first, and then what follows from it."""


class RobotAudit(Record):
    """One robot: of each kind of message, how many are recorded and how many the repetition gives."""

    id: str
    reads: tuple[str, ...]
    """The keys of the recording that this robot could read."""
    observations: Tally
    minds: Tally
    """One a decision; without their timings."""
    commands: Tally
    joined: int
    """How often it began with an empty memory."""


class Report(Record):
    """One audit. In JSON the version of this layout stands under ``schema``."""

    layout: Literal[1] = Field(default=1, alias="schema")
    result: Literal["follows", "differs", "interrupted"]
    recording: str
    facts: RunFacts
    repeated_with: str
    """The version of the software that repeated the run."""
    verdict: Verdict | None
    """Of the run; None if the recording ends without one."""
    last_step: int | None
    goals_told: bool
    """Whether the scene holds goals, as in a run with exchanged goals it does."""
    truths: Tally
    robots: tuple[RobotAudit, ...]
    differences: tuple[Difference, ...]
    """Of each robot's and the world's messages of one kind the first one, in the order of their steps."""

    def to_json(self) -> str:
        """The report as one JSON object."""
        return self.model_dump_json(by_alias=True, indent=2)


class Audit:
    """Repeats the world and then each robot of a run; what has been found so far can be asked at any time.

    Args:
        run: the recorded one.
    """

    def __init__(self, run: RecordedRun) -> None:
        self._run = run
        self._world = WorldReplay()
        self._robots: list[RobotAudit] = []
        self._differences: list[Difference] = []
        self._complete = False

    def go(self, watch: Watch) -> None:
        """Repeat everything. Without the scenario's own scene nothing can be repeated.

        Raises:
            KeyboardInterrupt: from ``watch``.
            ModuleNotFoundError: the library of a baseline is not installed here.
            RecordingError: the recording is damaged.
        """
        self._differences += self._run.strays()
        scene_difference = self._run.scene_difference()
        if scene_difference is not None:
            self._differences.append(scene_difference)
        else:
            self._world.repeat(self._run)
            self._differences += self._world.differences
            for robot in self._run.robots:
                self._robots.append(self._audited(robot, watch))
        self._complete = True

    def report(self) -> Report:
        """What has been found."""
        run, differences = self._run, first_ones(self._differences)
        return Report(
            result="interrupted" if not self._complete else "differs" if differences else "follows",
            recording=str(run.recording.path),
            facts=run.facts,
            repeated_with=version("unspoken"),
            verdict=self._world.verdict,
            last_step=self._world.last_step,
            goals_told=any(scene.scene.goals is not None for scene in run.scenes()),
            truths=self._world.truths,
            robots=tuple(self._robots),
            differences=differences,
        )

    def _audited(self, robot: str, watch: Watch) -> RobotAudit:
        replay = RobotReplay(self._run, robot, time.perf_counter)
        minds = Tally(len(replay.minds))
        commands = Tally(len(replay.surplus))
        watch(robot, 0, minds.recorded)
        for done, turn in enumerate(replay.turns(), 1):
            minds.identical += turn.mind_difference is None
            if turn.command is not None:
                commands.recorded += 1
                commands.identical += turn.command_difference is None
            self._differences += turn.differences
            watch(robot, done, minds.recorded)
        self._differences += replay.surplus
        return RobotAudit(
            id=robot,
            reads=self._run.readable_by(robot),
            observations=self._world.observations[robot],
            minds=minds,
            commands=commands,
            joined=sum(mind.decision == 0 for mind in replay.minds),
        )


def first_ones(differences: Sequence[Difference]) -> tuple[Difference, ...]:
    """One of each kind of message of each robot; of the whole run first, then step by step."""
    firsts: dict[tuple[Part, str | None], Difference] = {}
    for difference in sorted(differences, key=_moment):
        firsts.setdefault((difference.part, difference.robot), difference)
    return tuple(firsts.values())


def _moment(difference: Difference) -> tuple[int, int]:
    step = -1 if difference.step is None else difference.step
    return step, PARTS.index(difference.part)
