"""The world repeated: driven by the recorded commands, it should show every robot what was recorded."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from fleet.audit.difference import Difference, compared
from fleet.audit.recorded import RecordedRun, too_many
from fleet.run.listening import obeyed
from protocol.messages import Command, Truth, Verdict
from world.world import World

NOT_OF_THE_WORLD = frozenset({"refused"})
"""What a truth tells of messages that were no commands; it depends on more than the recorded ones."""


@dataclass
class Tally:
    """How many messages were recorded, and how many of them the repetition gives bit for bit."""

    recorded: int = 0
    identical: int = 0


@dataclass
class WorldReplay:
    """What came of it."""

    observations: Mapping[str, Tally]
    """By robot."""
    truths: Tally = field(default_factory=Tally)
    last_step: int | None = None
    """The last one whose truth is recorded and could be reached."""
    verdict: Verdict | None = None
    """As recorded; None for a recording that ends before."""
    differences: list[Difference] = field(default_factory=list)


def replay_world(run: RecordedRun) -> WorldReplay:
    """Repeat the world of a run with one scene, from its seed and the commands that the recorded one obeyed.

    Which these are shows in the truths: a robot whose command did not come in time has missed a deadline.
    What was recorded after the last truth is left out, since nothing tells what the world did then.
    """
    return _Repetition(run).made()


class _Repetition:
    def __init__(self, run: RecordedRun) -> None:
        [scene] = run.scenes()
        self._truths = run.truths()
        self._world = World(run.scenario, seed=run.facts.seed, epoch=scene.epoch)
        self._commands = {robot: run.commands(robot) for robot in run.robots}
        self._observations = {robot: run.observations(robot) for robot in run.robots}
        self._shown: set[int] = set()
        self._result = WorldReplay(
            {robot: Tally(sum(map(len, self._observations[robot].values()))) for robot in run.robots}
        )

    def made(self) -> WorldReplay:
        result = self._result
        result.truths.recorded = len(self._truths)
        if not self._truths:
            self._differ(Difference(part="truth", step=0, recorded=None, repeated="the start"))
        before = None
        for truth in self._truths:
            if not self._reaches(before, truth):
                return result
            self._compare_truth(truth)
            if truth.verdict is None:
                self._compare_observations(truth.step)
            result.last_step, result.verdict = truth.step, truth.verdict
            before = truth
        self._find_surplus()
        return result

    def _reaches(self, before: Truth | None, truth: Truth) -> bool:
        """Bring the world to the step of a truth; whether that was possible."""
        present, due = (0, 0) if before is None else (before.step, before.step + 1)
        if truth.verdict == "interrupted" and truth.step == present:
            self._world.interrupt()
        elif self._world.over:
            self._differ(Difference(part="truth", step=truth.step, recorded="a further step", repeated=None))
            return False
        elif truth.step != due:
            told = {"recorded": str(truth.step), "repeated": str(due)}
            self._differ(Difference(part="truth", step=due, field="step", **told))
            return False
        elif before is not None:
            self._world.advance(self._obeyed(before, truth))
        return True

    def _obeyed(self, before: Truth, after: Truth) -> dict[str, Command]:
        """The commands that led from one truth to the next: of each robot the first valid one."""
        commands = {}
        for robot, step in obeyed(before, after).items():
            given = self._commands.get(robot, {}).get(step, [])
            valid = [command for command in given if self._world.refusal(robot, command) is None]
            if valid:
                commands[robot] = valid[0]
            else:
                what = "one that the world obeyed"
                self._differ(Difference(part="command", robot=robot, step=step, recorded=None, repeated=what))
        return commands

    def _compare_truth(self, truth: Truth) -> None:
        difference = compared("truth", truth, self._world.truth(), without=NOT_OF_THE_WORLD)
        self._result.truths.identical += difference is None
        self._differ(difference)

    def _compare_observations(self, step: int) -> None:
        self._shown.add(step)
        for robot, repeated in self._world.observations().items():
            tally, recorded = self._result.observations[robot], self._observations[robot].get(step)
            if recorded is None:
                told = repeated.model_dump_json()
                self._differ(
                    Difference(part="observation", robot=robot, step=step, recorded=None, repeated=told)
                )
                continue
            difference = compared("observation", recorded[0], repeated, robot=robot)
            tally.identical += difference is None
            self._differ(difference)

    def _find_surplus(self) -> None:
        """What the world has not shown. Without a verdict, the beginning of one more step may be recorded."""
        for robot, observations in self._observations.items():
            judged = {
                step: several
                for step, several in observations.items()
                if self._result.verdict is not None or step in self._shown
            }
            self._result.observations[robot].recorded = sum(map(len, judged.values()))
            self._result.differences += too_many("observation", robot, judged, self._shown)

    def _differ(self, difference: Difference | None) -> None:
        if difference is not None:
            self._result.differences.append(difference)
