"""A recorded run repeated: the world from its commands, and each robot from its own observations."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from agent.agent import Agent, Decision
from agent.solve.deadline import Clock, Deadline
from fleet.audit.difference import Difference, Part, compared
from fleet.audit.recorded import RecordedRun, too_many
from fleet.run.listening import obeyed
from fleet.run.virtual import agent_of
from protocol.messages import Command, Mind, Observation, Truth, Verdict
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


MEASURED = frozenset({"timings_ms"})
"""What no repetition gives again: it is measured with a clock."""

BeforeDeciding = Callable[[Agent, Observation], None]


@dataclass(frozen=True)
class Turn:
    """One decision, recorded and repeated."""

    recorded: Mind
    command: Command | None
    """As recorded; None where it was withdrawn, since it would have come too late."""
    repeated: Decision | None
    """None where the decision could not be repeated."""
    mind_difference: Difference | None
    command_difference: Difference | None

    @property
    def differences(self) -> list[Difference]:
        """Those that there are."""
        return [each for each in (self.mind_difference, self.command_difference) if each is not None]


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
        clock: times the repetition; it changes no decision.
    """

    def __init__(self, run: RecordedRun, robot: str, clock: Clock) -> None:
        self.robot = robot
        self._run = run
        self._clock = clock
        self._observations = run.observations(robot)
        self._commands = run.commands(robot)
        self.minds = run.minds(robot)
        """One a decision, in their order."""

    @cached_property
    def surplus(self) -> list[Difference]:
        """Commands that no decision of this robot gave."""
        return too_many("command", self.robot, self._commands, {mind.step for mind in self.minds})

    def turns(self, before: BeforeDeciding = lambda _agent, _observation: None) -> Iterator[Turn]:
        """Repeat one decision after the other.

        Args:
            before: called before each decision.

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
            return self._unrepeated(mind, command, "no decision: the observation is missing")
        observation = self._observations[mind.step][0]
        before(agent, observation)
        try:
            decision = agent.decide(observation)
        # A robot that decides nothing at a step has recorded nothing, so whatever fails here is a difference.
        except (ArithmeticError, LookupError, RuntimeError, ValueError) as error:
            return self._unrepeated(mind, command, f"no decision: {type(error).__name__}: {error}")
        if decision is None:
            why = "no decision: this robot is not in the observation, or has decided on a newer one"
            return self._unrepeated(mind, command, why)
        return Turn(
            mind,
            command,
            decision,
            compared("mind", mind, decision.mind, robot=self.robot, without=MEASURED),
            None if command is None else compared("command", command, decision.command, robot=self.robot),
        )

    def _unrepeated(self, mind: Mind, command: Command | None, why: str) -> Turn:
        parts: tuple[Part, Part] = ("mind", "command")
        mind_difference, command_difference = (
            Difference(part=part, robot=self.robot, step=mind.step, recorded="a decision", repeated=why)
            for part in parts
        )
        return Turn(mind, command, None, mind_difference, None if command is None else command_difference)

    def _joins(self, deadline: RepeatedDeadline) -> Agent:
        [public] = self._run.scenes()
        [robot] = [each for each in self._run.scenario.robots if each.id == self.robot]
        return agent_of(robot, public.scene, self._run.facts, self._clock, deadline)
