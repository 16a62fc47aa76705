"""The thin shell around the core: poses come in over Zenoh, minds and commands go out."""

import math
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Protocol

import typer
import zenoh

from agent.agent import Agent, Decision
from agent.process.health import RobotHealth
from agent.process.inbox import Inbox
from agent.process.options import RobotOptions
from agent.process.warm import compile_in_background, warm_up
from agent.solve.compiled import forbid_compiling
from chassis.health import watch_port
from chassis.lean import structlog
from chassis.process import end_with_parent, log_to_journal, on_wish_to_end
from chassis.refusal import ExitStatus, Refusal, said_by
from protocol.codec import MessageError, OtherVersionError, decode, encode
from protocol.identity import DeviceKeys, Identity, Login, client_identity
from protocol.keys import Keys
from protocol.messages import Command, Joining, Message, Observation, PublicScene
from protocol.scene import Scene
from protocol.session import NEVER_DROP, Opening, client_session, reason_of
from protocol.version import PROTOCOL_VERSION, disagreement

SCENE_TIMEOUT_S = 1.0
"""After this time without an answer the scene is asked for again."""
SCENE_PAUSE_S = 0.1
"""Between two questions: a world can be reached a moment before it answers."""
LATE_EVERY_S = 5.0
"""The log tells of a late decision at once, but not of one in each step."""


class Decides(Protocol):
    """A robot's mind; :class:`agent.agent.Agent` is one."""

    def decide(self, observation: Observation) -> Decision | None:
        """See :meth:`agent.agent.Agent.decide`."""

    def withdraw(self) -> None:
        """See :meth:`agent.agent.Agent.withdraw`."""


MakeAgent = Callable[[RobotOptions, Scene], Decides]
"""Makes the mind of a robot; a ValueError says that its estimator needs what the scene does not hold."""


def make_agent(options: RobotOptions, scene: Scene) -> Agent:
    """The algorithm itself.

    Raises:
        ValueError: the estimator needs something that the scene does not hold.
    """
    return options.agent(options.robot, options.goal, scene, time.perf_counter)


def run_robot(options: RobotOptions, make_agent: MakeAgent = make_agent) -> None:
    """Be one robot, in this process, until SIGINT or SIGTERM.

    Raises:
        Refusal: it cannot go on; the sentence begins with its name.
    """
    end_with_parent()
    log_to_journal()
    name = f"robot {options.robot}"
    with said_by(name):
        now = datetime.now(UTC)
        identity = client_identity(options.robot, options.connect, options.password_file, options.keys, now)
        if isinstance(identity, DeviceKeys) and (warning := identity.warning(now)):
            typer.echo(f"{name}: {warning}", err=True)
        health = RobotHealth(options.robot, options.goal)
        process = RobotProcess(options, identity, make_agent, health)
        on_wish_to_end(process.stop)
        try:
            with watch_port(health, options.watch_port):
                process.run()
        except MessageError as error:
            raise Refusal(str(error), ExitStatus.FAILED) from None
        except zenoh.ZError as error:
            raise Refusal(
                f"the endpoint {options.connect} cannot be used: {reason_of(error)}; the one at which the "
                "world listens is expected in --connect, such as tcp/127.0.0.1:7447",
                ExitStatus.FAILED,
            ) from None


class RobotProcess:
    """One robot on the bus, until it is stopped; worlds may come and go meanwhile."""

    def __init__(
        self, options: RobotOptions, identity: Identity, make_agent: MakeAgent, health: RobotHealth
    ) -> None:
        self._options = options
        self._identity = identity
        self._make_agent = make_agent
        self._health = health
        self._keys = Keys(options.run)
        self._log = structlog.get_logger("agent").bind(robot=options.robot)
        self._inbox = Inbox(self._log)
        self._opening = Opening()
        self._agent: Decides | None = None
        self._epoch: int | None = None
        self._stopped = False
        self._told_late_s = -math.inf

    def stop(self) -> None:
        """End :meth:`run` soon; may be called from any thread."""
        self._stopped = True
        self._opening.stop()
        self._inbox.close()

    def run(self) -> None:
        """Wait for a world, then answer each observation that is still the newest when it is taken.

        An answer that comes too late, when a newer observation is there already, is not given.

        Raises:
            Refusal: the world speaks another version of the protocol, does not know this robot, or does not
                share what its estimator needs; or the solver is not compiled and cannot be.
            zenoh.ZError: Zenoh cannot use the endpoint.
        """
        session = self._connect()
        if session is None:
            return
        with session:
            self._join(session)
            _poses = session.declare_subscriber(
                self._keys.pose(self._options.robot),
                lambda sample: self._inbox.store(sample.payload.to_bytes()),
            )
            # Presence comes last: it lets the world publish step 0.
            _presence = session.liveliness().declare_token(self._keys.alive(self._options.robot))
            while (news := self._inbox.next(self._beat)) is not None:
                # After a message in another version of the protocol the world may be another one.
                if isinstance(news, OtherVersionError) or news.epoch != self._epoch:
                    self._join(session)
                if self._agent and isinstance(news, Observation) and news.epoch == self._epoch:
                    self._answer(session, self._agent, news)
            self._health.ends()
        self._log.info("stopped", late_decisions=self._health.late)

    def _connect(self) -> zenoh.Session | None:
        """The session, once the world is there and this robot is ready; None if stopped before.

        Everything is compiled and loaded by then: later, there is no time for it.
        """
        connect = self._options.connect
        self._log.info("waiting for the world", connect=connect, run=self._options.run)
        self._opening.begin(client_session(connect, self._identity))
        self._health.wants("it loads the solver, or compiles it")
        self._health.beat()
        if compile_in_background(unwanted=self._is_stopped):
            duration_s = warm_up(self._options.goals, self._options.solver)
            forbid_compiling()
            self._log.info("ready to decide", loaded_in_s=round(duration_s, 2))
        self._health.wants(f"it waits for a world at {connect}")
        return self._opening.wait(self._health.beat, self._log_absence)

    def _log_absence(self) -> None:
        match self._identity:
            case None:
                proof = "nothing"
            case Login():
                proof = "password"
            case keys:
                proof = f"keys in {keys.folder}"
        self._log.warning(
            "still waiting: there is no world at this endpoint, or it refuses this robot",
            connect=self._options.connect,
            proves_itself_by=proof,
        )

    def _join(self, session: zenoh.Session) -> None:
        """Begin anew with the scene of the present world, unless stopped before.

        Where the world is still that of the present epoch, only a pose was wrong, and nothing begins anew.
        """
        while not self._is_stopped():
            public = ask_for_scene(session, self._keys, self._options.robot, SCENE_TIMEOUT_S)
            if public is None:
                time.sleep(SCENE_PAUSE_S)
                continue
            if public.epoch != self._epoch:
                self._log.info("joined", epoch=public.epoch, robots=len(public.scene.robots))
                self._agent = agent_in(public.scene, self._options, self._make_agent)
                self._epoch = public.epoch
                self._health.joined(len(public.scene.robots))
            return

    def _beat(self) -> None:
        """A sign of life, by the loop itself."""
        self._health.refused = self._inbox.refused
        self._health.beat()

    def _is_stopped(self) -> bool:
        """Asked again and again by what waits, which so gives signs of life."""
        self._health.beat()
        return self._stopped

    def _answer(self, session: zenoh.Session, agent: Decides, observation: Observation) -> None:
        """Decide and publish.

        The mind goes first, so that it is recorded before the step can end. It goes even when it is too late
        for the command: the record is to show what took so long.
        """

        def put(key: str, message: Message) -> None:
            # Unlike poses, of which the latest counts, these are not to be lost where a reader is slow.
            session.put(key, encode(message), **NEVER_DROP)

        robot, step, health = self._options.robot, observation.step, self._health
        health.observed(observation)
        decision = agent.decide(observation)
        if decision is None:
            health.withheld += 1
            put(self._keys.command(robot), Command.withheld_at(observation.epoch, robot, step))
            return
        health.decided(decision.mind)
        put(self._keys.mind(robot), decision.mind)
        if not self._inbox.has_news():
            put(self._keys.command(robot), decision.command)
        else:
            agent.withdraw()
            health.late += 1
            if health.now_s() - self._told_late_s >= LATE_EVERY_S:
                self._log.warning("decided too late", step=step, so_far=health.late)
                self._told_late_s = health.now_s()
        if decision.mind.failed:
            self._log.warning("not solved", step=step, phases=decision.mind.failed)


def ask_for_scene(session: zenoh.Session, keys: Keys, robot: str, timeout_s: float) -> PublicScene | None:
    """The scene of the present world; None if none has answered in time.

    The question tells the world which version of the protocol this robot speaks, and nothing else.

    Raises:
        Refusal: the world speaks another version.
        MessageError: the answer is not valid.
    """
    for reply in session.get(keys.scene_for(robot), payload=encode(Joining()), timeout=timeout_s):
        if reply.ok is not None:
            try:
                return decode(PublicScene, reply.ok.payload.to_bytes())
            except OtherVersionError as error:
                sentence = disagreement(robot, PROTOCOL_VERSION, error.version)
                raise Refusal(sentence, ExitStatus.FAILED) from None
    return None


def agent_in(scene: Scene, options: RobotOptions, make_agent: MakeAgent) -> Decides:
    """The mind of a robot in this scene.

    Raises:
        Refusal: the scene lacks this robot, or what its estimator needs.
    """
    if options.robot not in scene.robots:
        raise Refusal(
            f"this world has no robot {options.robot!r}; its robots are {', '.join(scene.robots)}. "
            "Start this robot with one of these ids, or the world with another scenario.",
            ExitStatus.FAILED,
        )
    try:
        return make_agent(options, scene)
    except ValueError as error:
        raise Refusal(str(error), ExitStatus.FAILED) from error
