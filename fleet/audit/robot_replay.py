"""One robot repeated: a new agent, given what its predecessor was given, should decide the same."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

from agent.agent import Agent, Decision
from agent.solve.deadline import Clock, Deadline
from fleet.audit.difference import Difference, Part, compared
from fleet.audit.recorded import RecordedRun, too_many
from fleet.run.moment import agent_of
from protocol.messages import Command, Mind, Observation

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
