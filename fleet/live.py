"""A run in real processes: a world, one process per robot, and the bench that listens to all of them."""

import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from queue import Empty, SimpleQueue

import structlog
import zenoh

from fleet.compiling import compile_solver
from fleet.crew import Crew, ProcessFailedError
from fleet.experiment import Experiment
from fleet.intake import Intake
from fleet.interruption import Interruption
from fleet.logins import Logins, NoLogins
from fleet.mailbox import Letter, Mailbox
from fleet.stragglers import Stragglers
from fleet.stream import TOO_MANY, BusMessage, RefusedMind
from protocol.codec import MessageError
from protocol.keys import Keys
from protocol.messages import Truth
from protocol.scenario import ScenarioRobot
from protocol.session import SessionSettings, client_session, open_in_background, reason_of

LOOK_S = 0.1
"""How often the bench looks after processes and interruptions while nothing arrives."""

STRAGGLERS_S = 1.0
"""How long a message that the verdict has overtaken may take."""

WORLD = "world"

SAID_BY_ROBOTS = ("command", "mind")

log = structlog.get_logger("bench")


def run_processes(
    experiment: Experiment, log_directory: Path, interruption: Interruption
) -> Iterator[BusMessage | RefusedMind]:
    """Every message of the bus, from the scene to the truth with the verdict, and what was refused of it.

    An interruption makes the world end the run, with its verdict. However the iteration is left, all
    processes have ended after it.

    Args:
        experiment: what to run.
        log_directory: made here; each process writes its log into it.
        interruption: looked at while waiting.

    Raises:
        ProcessFailedError: the solver cannot be compiled; the world or, before the first step, a robot ended;
            or a robot ended later, which is told after the verdict of the others.
        KeyboardInterrupt: an interruption came before the world could give a verdict, or came twice.
    """
    compile_solver(interruption)
    log_directory.mkdir()
    with tempfile.TemporaryDirectory(prefix="unspoken-") as directory, Crew(log_directory) as crew:
        endpoint = f"unixsock-stream/{directory}/world.sock"
        robots = experiment.scenario.robots
        logins = _logins(experiment, Path(directory))
        crew.start(WORLD, "world", _world_settings(experiment, endpoint) | logins.of_world())
        bench = _Bench(experiment, crew, interruption)
        with bench.connect(client_session(endpoint, logins.bench)) as session:
            yield from bench.subscribe(session)
            for robot in robots:
                settings = _robot_settings(experiment, endpoint, robot) | logins.of_robot(robot.id)
                crew.start(f"robot-{robot.id}", "agent", settings)
            yield from bench.listen()
        crew.wait(WORLD)  # which stays until the bench has left


def _logins(experiment: Experiment, directory: Path) -> Logins | NoLogins:
    if not experiment.facts.policy:
        return NoLogins()
    return Logins(directory, [robot.id for robot in experiment.scenario.robots])


def _world_settings(experiment: Experiment, endpoint: str) -> dict[str, str]:
    facts = experiment.facts
    return {
        "scenario": str(experiment.path),
        "listen": endpoint,
        "run": facts.run,
        "clock": facts.clock,
        "seed": str(facts.seed),
        "exchange_goals": "1" if experiment.facts.goals_are_exchanged else "0",
    }


def _robot_settings(experiment: Experiment, endpoint: str, robot: ScenarioRobot) -> dict[str, str]:
    facts, goal = experiment.facts, robot.goal_pose()
    budget = {} if facts.budget_ms is None else {"budget_ms": repr(facts.budget_ms)}
    return budget | {
        "robot": robot.id,
        "goal": f"{goal.x_m!r},{goal.y_m!r},{goal.heading_rad!r}",
        "connect": endpoint,
        "run": facts.run,
        "goals": facts.goals,
        "solver": facts.solver,
        "iterations": str(facts.iterations),
    }


class _Bench:
    """The listening side. Callbacks only store; everything else happens where the messages are taken."""

    def __init__(self, experiment: Experiment, crew: Crew, interruption: Interruption) -> None:
        self._keys = Keys(experiment.facts.run)
        self._crew = crew
        self._interruption = interruption
        self._mailbox = Mailbox()
        self._intake = Intake(self._keys)
        self._begun = False
        self._told_to_end = False

    def connect(self, settings: SessionSettings) -> zenoh.Session:
        """The bench's session, once the world listens.

        Raises:
            ProcessFailedError: the world ended instead.
        """
        opened: SimpleQueue[zenoh.Session | zenoh.ZError] = SimpleQueue()
        open_in_background(settings, opened.put)
        while True:
            try:
                session = opened.get(timeout=LOOK_S)
            except Empty:
                self._hand_on_interruption()
                self._give_up_without(self._crew.ended())
                continue
            if isinstance(session, zenoh.ZError):
                raise ProcessFailedError(f"the bench cannot reach its world: {reason_of(session)}")
            return session

    def subscribe(self, session: zenoh.Session) -> Iterator[BusMessage | RefusedMind]:
        """Listen to everything, then yield the scene.

        The world's answer shows that it knows of the subscription, which was declared before the question.
        """
        self._subscriber = session.declare_subscriber(self._keys.everything, self._store)
        while True:
            for reply in session.get(self._keys.scene, timeout=1.0):
                if reply.ok is not None:
                    letter = Letter(self._keys.scene, reply.ok.payload.to_bytes(), time.time_ns())
                    yield from self._taken(letter)
                    return
            self._hand_on_interruption()
            self._give_up_without(self._crew.ended())
            time.sleep(LOOK_S)

    def listen(self) -> Iterator[BusMessage | RefusedMind]:
        """Messages up to the truth with the verdict, and those that it has overtaken."""
        stragglers, verdict = Stragglers(), None
        while verdict is None:
            self._hand_on_interruption()
            try:
                letter = self._mailbox.get(LOOK_S)
            except Empty:
                ended = self._crew.ended()
                if self._mailbox.empty():  # what processes said before they ended counts first
                    self._give_up_without(ended)
                continue
            for item in self._taken(letter):
                if isinstance(item, BusMessage):
                    stragglers.add(item.message)
                    if isinstance(item.message, Truth):
                        self._begun = True
                        verdict = item.message.verdict
                yield item
        yield from self._take_in(stragglers)
        yield from (RefusedMind(robot, TOO_MANY, count) for robot, count in self._mailbox.lost.items())
        failures = [account for name, account in self._crew.ended().items() if name != WORLD]
        if failures:
            raise ProcessFailedError("\n".join(failures))

    def _take_in(self, stragglers: Stragglers) -> Iterator[BusMessage | RefusedMind]:
        """Messages until the last command is there, or none has come for a while."""
        while stragglers.on_their_way():
            try:
                letter = self._mailbox.get(STRAGGLERS_S)
            except Empty:
                log.warning("the recording lacks commands of the last step")
                return
            for item in self._taken(letter):
                if isinstance(item, BusMessage):
                    stragglers.add(item.message)
                yield item

    def _store(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        sender = self._keys.robot_of(key) if self._keys.kind_of(key) in SAID_BY_ROBOTS else None
        self._mailbox.put(sender, Letter(key, sample.payload.to_bytes(), time.time_ns()))

    def _taken(self, letter: Letter) -> Iterator[BusMessage | RefusedMind]:
        """What is to be told of a message, if anything is."""
        try:
            item = self._intake.take(letter)
        except (MessageError, KeyError) as error:
            log.warning("not recorded", key=letter.key, reason=str(error))
        else:
            if item is not None:
                yield item

    def _give_up_without(self, ended: Mapping[str, str]) -> None:
        """End the run where it cannot go on without the processes that have ended."""
        if WORLD in ended or (ended and not self._begun):
            if self._interruption.requested:
                raise KeyboardInterrupt
            raise ProcessFailedError(ended.get(WORLD) or "\n".join(ended.values()))

    def _hand_on_interruption(self) -> None:
        """The world ends an interrupted run, with its verdict; whoever insists does without one."""
        if self._interruption.insisted:
            raise KeyboardInterrupt
        if self._interruption.requested and not self._told_to_end:
            self._told_to_end = True
            self._crew.ask_to_end(WORLD)
