"""The bridge's process: a session for the agents, one for the side of ROS, and a run between them."""

import secrets
from contextlib import ExitStack, closing
from dataclasses import dataclass

import structlog
import zenoh
from structlog.typing import FilteringBoundLogger

from chassis.process import on_wish_to_end
from chassis.watching import watch_port
from protocol.keys import Keys
from protocol.messages import PublicScene
from protocol.session import Opening, client_session, reason_of, receive_on_threads
from world.access import Access, most_sessions
from world.bus import Bus
from world.clock import RealTime
from world.health import WorldHealth
from world.inbox import Inbox
from world.process import FAREWELL_S, EndpointError, open_session
from world.ros2.bus import OdometryInbox, Ros
from world.ros2.live import LiveWorld
from world.ros2.settings import Ros2Bridge
from world.ros2.world import OdometryWorld
from world.run import Run


@dataclass(frozen=True)
class BridgeOptions:
    """What a bridge is told at its start."""

    settings: Ros2Bridge
    access: Access
    run: str
    start_timeout_s: float
    watch_port: int | None = None
    """None: nobody watches."""


def run_bridge(options: BridgeOptions) -> None:
    """Be the world of real robots until SIGINT or SIGTERM; at the end all of them are told to stand.

    Raises:
        AccessError: who may connect is not said as it must be.
        EndpointError: an endpoint cannot be used.
        RobotsMissingError: agents were missing at the start.
        Refusal: the watch port cannot be used.
    """
    log: FilteringBoundLogger = structlog.get_logger("bridge")
    settings, keys, epoch = options.settings, Keys(options.run), secrets.randbits(63)
    core = OdometryWorld(settings, epoch=epoch)
    health = WorldHealth(core.robots)
    inbox, odometry, opening = Inbox(core.robots), OdometryInbox(core.robots), Opening()

    def end() -> None:
        inbox.interrupt()
        opening.stop()

    on_wish_to_end(end)
    agents = options.access.session(keys, core.robots, log)
    receive_on_threads(most_sessions(core.robots) + 1)
    with ExitStack() as stack:
        stack.enter_context(watch_port(health, options.watch_port))
        session = stack.enter_context(open_session(options.access.listen, agents))
        stack.enter_context(closing(inbox))
        log.info("waiting for the side of ROS", connect=settings.connect)
        health.wants(f"it waits for the side of ROS at {settings.connect}")
        ros_session = _open_ros(settings.connect, opening, log, health)
        if ros_session is None:
            return
        ros = Ros(stack.enter_context(ros_session), settings, odometry)
        world = LiveWorld(core, odometry, ros, log)
        stack.callback(world.stop)
        scene = PublicScene(epoch=epoch, scene=settings.scene())
        bus = Bus(session, keys, scene, core.robots, inbox)
        log.info(
            "bridge started",
            robots=len(core.robots),
            listen=options.access.listen,
            connect=settings.connect,
            run=options.run,
            epoch=epoch,
        )
        health.up()
        run = Run(world, RealTime(settings.step_s), inbox, bus, log, health, heed=world.heed)
        run.wait_for_robots(options.start_timeout_s)
        world.begin()
        run.drive()
        health.ends()
        world.stop()
        log.info("robots stopped", refused_odometry=world.refused_odometry)
        bus.wait_for_readers(FAREWELL_S)


def _open_ros(
    connect: str, opening: Opening, log: FilteringBoundLogger, health: WorldHealth
) -> zenoh.Session | None:
    def tell_absence() -> None:
        log.warning("still waiting: there is no Zenoh router of ROS at this endpoint", connect=connect)

    try:
        opening.begin(client_session(connect))
        return opening.wait(health.beat, tell_absence)
    except zenoh.ZError as error:
        raise EndpointError(
            f"the endpoint {connect} of the side of ROS cannot be used: {reason_of(error)}; that of its "
            "router is expected in 'connect', such as tcp/127.0.0.1:7447"
        ) from error
