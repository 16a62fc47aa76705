"""A recorded run repeated: the world from its commands, and each robot from its own observations."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from agent.agent import Agent, Decision
from agent.solve.deadline import Clock, Deadline
from fleet.audit.difference import Difference, compared
from fleet.audit.recorded import RecordedRun, too_many
from fleet.run.listening import obeyed
from fleet.run.virtual import agent_of
from protocol.messages import Command, Message, Mind, Observation, Truth, Verdict
from world.world import World

NOT_OF_THE_WORLD = frozenset({"refused"})
"""Part of a truth that counts messages that were no commands; it depends on more than the recorded ones."""
MEASURED = frozenset({"timings_ms"})
"""What no repetition gives again: it is measured with a clock."""

Commands = Mapping[str, Mapping[int, Sequence[Command]]]
"""By robot and step, in their order."""
BeforeDeciding = Callable[[Agent, Observation], None]


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
            self._differ(Difference(part="truth", step=0, recorded=None, repeated="the start"))
        before = None
        for truth in truths:
            if not self._reaches(world, before, truth, commands):
                return
            difference = compared("truth", truth, world.truth(), without=NOT_OF_THE_WORLD)
            self.truths.identical += difference is None
            self._differ(difference)
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
            self._differ(Difference(part="truth", step=truth.step, recorded="a further step", repeated=None))
            return False
        elif truth.step != due:
            steps = {"recorded": str(truth.step), "repeated": str(due)}
            self._differ(Difference(part="truth", step=due, field="step", **steps))
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
                self._differ(Difference(part="command", robot=robot, step=step, recorded=None, repeated=what))
        return found

    def _compare_observations(
        self, world: World, step: int, observations: Mapping[str, Mapping[int, Sequence[Observation]]]
    ) -> None:
        for robot, repeated in world.observations().items():
            recorded = observations[robot].get(step)
            if recorded is None:
                given = {"recorded": None, "repeated": repeated.model_dump_json()}
                self._differ(Difference(part="observation", robot=robot, step=step, **given))
            else:
                difference = compared("observation", recorded[0], repeated, robot=robot)
                self.observations[robot].identical += difference is None
                self._differ(difference)

    def _differ(self, difference: Difference | None) -> None:
        if difference is not None:
            self.differences.append(difference)


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
        place = {"robot": self.robot, "step": mind.step, "recorded": "a decision", "repeated": why}
        mind_difference = Difference.model_validate({"part": "mind", **place})
        command_difference = mind_difference.model_copy(update={"part": "command"})
        return Turn(mind, command, None, mind_difference, None if command is None else command_difference)

    def _joins(self, deadline: RepeatedDeadline) -> Agent:
        [public] = self._run.scenes()
        [robot] = [each for each in self._run.scenario.robots if each.id == self.robot]
        return agent_of(robot, public.scene, self._run.facts, self._clock, deadline)
