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
from fleet.interruption import Interruption
from fleet.stragglers import Stragglers
from fleet.stream import KINDS, BusMessage
from protocol.codec import MessageError, decode
from protocol.keys import Keys
from protocol.messages import Truth
from protocol.scenario import ScenarioRobot
from protocol.session import bench_session, open_in_background, reason_of

LOOK_S = 0.1
"""How often the bench looks after processes and interruptions while nothing arrives."""

STRAGGLERS_S = 1.0
"""How long a message that the verdict has overtaken may take."""

WORLD = "world"

log = structlog.get_logger("bench")


def run_processes(
    experiment: Experiment, log_directory: Path, interruption: Interruption
) -> Iterator[BusMessage]:
    """Every message of the bus, from the scene to the truth with the verdict.

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
        crew.start(WORLD, "world", _world_settings(experiment, endpoint))
        bench = _Bench(experiment, crew, interruption)
        with bench.connect(endpoint) as session:
            yield from bench.subscribe(session)
            for robot in experiment.scenario.robots:
                crew.start(f"robot-{robot.id}", "agent", _robot_settings(experiment, endpoint, robot))
            yield from bench.listen()
        crew.wait(WORLD)  # which stays until the bench has left


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
        self._inbox: SimpleQueue[tuple[str, bytes, int]] = SimpleQueue()
        self._begun = False
        self._told_to_end = False

    def connect(self, endpoint: str) -> zenoh.Session:
        """The bench's session, once the world listens.

        Raises:
            ProcessFailedError: the world ended instead.
        """
        opened: SimpleQueue[zenoh.Session | zenoh.ZError] = SimpleQueue()
        open_in_background(bench_session(endpoint), opened.put)
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

    def subscribe(self, session: zenoh.Session) -> Iterator[BusMessage]:
        """Listen to everything, then yield the scene.

        The world's answer shows that it knows of the subscription, which was declared before the question.
        """
        self._subscriber = session.declare_subscriber(
            self._keys.everything,
            lambda sample: self._inbox.put((str(sample.key_expr), sample.payload.to_bytes(), time.time_ns())),
        )
        while True:
            for reply in session.get(self._keys.scene, timeout=1.0):
                if reply.ok is not None:
                    yield self._decoded(self._keys.scene, reply.ok.payload.to_bytes(), time.time_ns())
                    return
            self._hand_on_interruption()
            self._give_up_without(self._crew.ended())
            time.sleep(LOOK_S)

    def listen(self) -> Iterator[BusMessage]:
        """Messages up to the truth with the verdict, and those that it has overtaken."""
        stragglers, verdict = Stragglers(), None
        while verdict is None:
            self._hand_on_interruption()
            try:
                item = self._inbox.get(timeout=LOOK_S)
            except Empty:
                ended = self._crew.ended()
                if self._inbox.empty():  # what processes said before they ended counts first
                    self._give_up_without(ended)
                continue
            for message in self._readable(*item):
                stragglers.add(message.message)
                if isinstance(message.message, Truth):
                    self._begun = True
                    verdict = message.message.verdict
                yield message
        yield from self._take_in(stragglers)
        failures = [account for name, account in self._crew.ended().items() if name != WORLD]
        if failures:
            raise ProcessFailedError("\n".join(failures))

    def _take_in(self, stragglers: Stragglers) -> Iterator[BusMessage]:
        """Messages until the last command is there, or none has come for a while."""
        while stragglers.on_their_way():
            try:
                item = self._inbox.get(timeout=STRAGGLERS_S)
            except Empty:
                log.warning("the recording lacks commands of the last step")
                return
            for message in self._readable(*item):
                stragglers.add(message.message)
                yield message

    def _readable(self, key: str, payload: bytes, time_ns: int) -> Iterator[BusMessage]:
        """The message, if it is one."""
        try:
            message = self._decoded(key, payload, time_ns)
        except (MessageError, KeyError) as error:
            log.warning("not recorded", key=key, reason=str(error))
        else:
            yield message

    def _decoded(self, key: str, payload: bytes, time_ns: int) -> BusMessage:
        return BusMessage(key, decode(KINDS[self._keys.kind_of(key)], payload), time_ns)

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
