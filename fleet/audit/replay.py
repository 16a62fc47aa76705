"""A recorded run repeated: the world from its commands, and each robot from its own observations.

The JSON of the report is a contract, described in docs/auditing.md.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import version
from typing import Literal

from pydantic import Field

from agent.agent import Agent, Decision
from agent.solve import Deadline
from chassis.files import Record
from fleet.audit.recorded import Difference, Part, RecordedRun, compared, too_many
from fleet.record.experiment import RunFacts
from fleet.run.listening import obeyed
from protocol.messages import Command, Message, Mind, Observation, Truth, Verdict
from world.world import World

NOT_OF_THE_WORLD = frozenset({"refused"})
"""Part of a truth that counts messages that were no commands; it depends on more than the recorded ones."""
MEASURED = frozenset({"timings_ms"})
"""What no repetition gives again: it is measured with a clock."""

Commands = Mapping[str, Mapping[int, Sequence[Command]]]
"""By robot and step, in their order."""
BeforeDeciding = Callable[[Agent, Observation], None]
Watch = Callable[[str, int, int], None]
"""Told of a robot how many decisions are done, and how many there are. May raise KeyboardInterrupt."""
PARTS: tuple[Part, ...] = ("key", "scene", "truth", "observation", "mind", "command")
"""In this order differences of one step are told: what is given first, and then what follows from it."""


@dataclass
class Tally:
    """How many messages were recorded, and how many of them the repetition gives bit for bit."""

    recorded: int = 0
    identical: int = 0


@dataclass
class WorldReplay:
    """The world of a run with one scene, driven by the recorded commands that the recorded one obeyed.

    Which these are shows in the truths: a robot whose command did not come in time has missed a deadline.
    What was recorded after the last truth is left out, since nothing says what the world did then.
    """

    observations: dict[str, Tally] = field(default_factory=dict)
    """By robot."""
    truths: Tally = field(default_factory=Tally)
    last_step: int | None = None
    """The last one whose truth is recorded and could be reached."""
    verdict: Verdict | None = None
    """As recorded; None for a recording that ends before."""
    differences: list[Difference] = field(default_factory=list)

    def repeat(self, run: RecordedRun) -> None:
        """Repeat the world from its seed, and compare what it says with what is recorded."""
        [scene] = run.scenes()
        truths = run.truths()
        world = World(run.scenario, seed=run.facts.seed, epoch=scene.epoch)
        commands = {robot: run.commands(robot) for robot in run.robots}
        observations = {robot: run.observations(robot) for robot in run.robots}
        self.observations = {robot: Tally(_count(steps)) for robot, steps in observations.items()}
        self.truths.recorded = len(truths)
        shown: set[int] = set()
        if not truths:
            self.differences.append(Difference(part="truth", step=0, recorded=None, repeated="the start"))
        before = None
        for truth in truths:
            if not self._reaches(world, before, truth, commands):
                return
            found = compared("truth", truth, world.truth(), without=NOT_OF_THE_WORLD)
            self.truths.identical += not found
            self.differences += found
            if truth.verdict is None:
                shown.add(truth.step)
                self._compare_observations(world, truth.step, observations)
            self.last_step, self.verdict = truth.step, truth.verdict
            before = truth
        for robot, steps in observations.items():
            # Without a verdict, the beginning of one more step may be recorded.
            judged = {step: steps[step] for step in steps if self.verdict is not None or step in shown}
            self.observations[robot].recorded = _count(judged)
            self.differences += too_many("observation", robot, judged, shown)

    def _reaches(self, world: World, before: Truth | None, truth: Truth, commands: Commands) -> bool:
        """Bring the world to the step of a truth; whether that was possible."""
        present, due = (0, 0) if before is None else (before.step, before.step + 1)
        if truth.verdict == "interrupted" and truth.step == present:
            world.interrupt()
        elif world.over:
            further = Difference(part="truth", step=truth.step, recorded="a further step", repeated=None)
            self.differences.append(further)
            return False
        elif truth.step != due:
            steps = {"recorded": str(truth.step), "repeated": str(due)}
            self.differences.append(Difference(part="truth", step=due, field="step", **steps))
            return False
        elif before is not None:
            world.advance(self._obeyed(world, before, truth, commands))
        return True

    def _obeyed(self, world: World, before: Truth, after: Truth, commands: Commands) -> dict[str, Command]:
        """The commands that led from one truth to the next: of each robot the first valid one."""
        found = {}
        for robot, step in obeyed(before, after).items():
            several = commands.get(robot, {}).get(step, [])
            valid = [command for command in several if world.refusal(robot, command) is None]
            if valid:
                found[robot] = valid[0]
            else:
                what = "one that the world obeyed"
                lacking = Difference(part="command", robot=robot, step=step, recorded=None, repeated=what)
                self.differences.append(lacking)
        return found

    def _compare_observations(
        self, world: World, step: int, observations: Mapping[str, Mapping[int, Sequence[Observation]]]
    ) -> None:
        for robot, repeated in world.observations().items():
            if step in observations[robot]:
                found = compared("observation", observations[robot][step][0], repeated, robot=robot)
                self.observations[robot].identical += not found
                self.differences += found
            else:
                text = repeated.model_dump_json()
                lacking = Difference(part="observation", robot=robot, step=step, recorded=None, repeated=text)
                self.differences.append(lacking)


def _count(by_step: Mapping[int, Sequence[Message]]) -> int:
    return sum(map(len, by_step.values()))


@dataclass(frozen=True)
class Turn:
    """One decision, recorded and repeated."""

    recorded: Mind
    command: Command | None
    """As recorded; None where it was withdrawn, since it would have come too late."""
    repeated: Decision | None
    """None where the decision could not be repeated."""
    differences: Sequence[Difference]
    """At most one of the mind, and one of the command."""


class RepeatedDeadline(Deadline):
    """One that cuts decisions short where others were cut short, whatever time it is.

    Attributes:
        repeated: the ``cut_short_at`` of the decision that is repeated next.
    """

    def __init__(self) -> None:
        super().__init__(lambda: 0.0, None)
        self.repeated: int | None = None

    def _is_over(self, question: int) -> bool:
        return question == self.repeated


class RobotReplay:
    """The decisions of one robot, repeated from its own recorded observations and the recorded scene.

    Of the minds, the repetition takes only which observations the robot decided on, when it joined and where
    its time was over, and of the commands only which were withdrawn. Both are what it is compared with.

    Args:
        run: with one scene, that of the scenario.
        robot: one of the run.
    """

    def __init__(self, run: RecordedRun, robot: str) -> None:
        self.robot = robot
        self._run = run
        self._observations = run.observations(robot)
        self._commands = run.commands(robot)
        self.minds = run.minds(robot)
        """One a decision, in their order."""

    @cached_property
    def surplus(self) -> list[Difference]:
        """Commands that no decision of this robot gave."""
        return too_many("command", self.robot, self._commands, {mind.step for mind in self.minds})

    def turns(self, before: BeforeDeciding = lambda _agent, _observation: None) -> Iterator[Turn]:
        """Repeat one decision after the other; ``before`` is called before each.

        Raises:
            ModuleNotFoundError: the library of a baseline is not installed here.
        """
        deadline = RepeatedDeadline()
        agent = None
        for mind in self.minds:
            if agent is None or mind.decision == 0:
                agent = self._joins(deadline)
            deadline.repeated = mind.cut_short_at
            command = self._commands[mind.step][0] if mind.step in self._commands else None
            turn = self._turn(agent, mind, command, before)
            yield turn
            if command is None and turn.repeated is not None:
                agent.withdraw()

    def _turn(self, agent: Agent, mind: Mind, command: Command | None, before: BeforeDeciding) -> Turn:
        if mind.step not in self._observations:
            return self._unrepeated(mind, command, "the observation is missing")
        observation = self._observations[mind.step][0]
        before(agent, observation)
        try:
            decision = agent.decide(observation)
        # A robot that decides nothing at a step has recorded nothing, so whatever fails here is a difference.
        except (ArithmeticError, LookupError, RuntimeError, ValueError) as error:
            return self._unrepeated(mind, command, f"{type(error).__name__}: {error}")
        if decision is None:
            why = "this robot is not in the observation, or has decided on a newer one"
            return self._unrepeated(mind, command, why)
        differences = compared("mind", mind, decision.mind, robot=self.robot, without=MEASURED)
        if command is not None:
            differences += compared("command", command, decision.command, robot=self.robot)
        return Turn(mind, command, decision, differences)

    def _unrepeated(self, mind: Mind, command: Command | None, why: str) -> Turn:
        parts: tuple[Part, ...] = ("mind",) if command is None else ("mind", "command")
        told = {"recorded": "a decision", "repeated": f"no decision: {why}"}
        differences = [Difference(part=part, robot=self.robot, step=mind.step, **told) for part in parts]
        return Turn(mind, command, None, differences)

    def _joins(self, deadline: RepeatedDeadline) -> Agent:
        [public] = self._run.scenes()
        [robot] = [each for each in self._run.scenario.robots if each.id == self.robot]
        return self._run.facts.agent(robot.id, robot.goal_pose(), public.scene, time.perf_counter, deadline)


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
            Refusal: the recording is damaged.
        """
        scene_differences = self._run.scene_differences()
        self._differences += [*self._run.strays(), *scene_differences]
        if not scene_differences:
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
        replay = RobotReplay(self._run, robot)
        minds = Tally(len(replay.minds))
        commands = Tally(len(replay.surplus))
        watch(robot, 0, minds.recorded)
        for done, turn in enumerate(replay.turns(), 1):
            differing = {difference.part for difference in turn.differences}
            minds.identical += "mind" not in differing
            if turn.command is not None:
                commands.recorded += 1
                commands.identical += "command" not in differing
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

    def moment(difference: Difference) -> tuple[int, int]:
        step = -1 if difference.step is None else difference.step
        return step, PARTS.index(difference.part)

    firsts: dict[tuple[Part, str | None], Difference] = {}
    for difference in sorted(differences, key=moment):
        firsts.setdefault((difference.part, difference.robot), difference)
    return tuple(firsts.values())
