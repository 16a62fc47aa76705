"""``python -m world.ros2``: the process of the bridge to ROS 2 and its command line."""

import secrets
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Annotated

import typer
import zenoh
from structlog.typing import FilteringBoundLogger

from chassis.files import read_as
from chassis.health import watch_port
from chassis.lean import structlog
from chassis.options import with_options
from chassis.process import end_with_parent, log_to_journal, on_wish_to_end
from chassis.refusal import ExitStatus, Refusal, run, said_by
from protocol.keys import Keys
from protocol.messages import PublicScene
from protocol.session import Opening, client_session, reason_of, receive_on_threads
from world.access import HostOptions, ListenEndpoint, most_sessions
from world.bus import Bus, Inbox, open_session
from world.clock import RealTime
from world.health import WorldHealth
from world.ros2.live import LiveWorld, OdometryInbox, Ros
from world.ros2.odometry import Ros2Bridge
from world.run import Run


class BridgeOptions(HostOptions):
    """What the process of the bridge is told at its start."""

    listen: ListenEndpoint = "tcp/127.0.0.1:7448"


@with_options(environment=True)
def main(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="BRIDGE",
            envvar="UNSPOKEN_BRIDGE",
            help="YAML file with the robots, their topics and the endpoint of the ROS side.",
        ),
    ],
    options: BridgeOptions,
) -> None:
    """Connect real robots: ROS 2 odometry becomes the agents' poses, and their commands become ROS 2 twists.

    It replaces the world until stopped by SIGINT or SIGTERM, and then stops all robots.

    Exit status: 0 stopped, 2 invalid usage, file, passwords or keys, 3 agents were missing at the start or an
    endpoint or the watch port cannot be used.
    """
    end_with_parent()
    log_to_journal()
    log: FilteringBoundLogger = structlog.get_logger("bridge")
    bridge = read_as(file, Ros2Bridge, "file of a bridge")
    keys, epoch = Keys(options.run), secrets.randbits(63)
    robots = tuple(robot.id for robot in bridge.robots)
    inbox, odometry, opening, health = Inbox(robots), OdometryInbox(robots), Opening(), WorldHealth(robots)

    def end() -> None:
        inbox.interrupt()
        opening.stop()

    on_wish_to_end(end)
    receive_on_threads(most_sessions(robots) + 1)
    with ExitStack() as stack:
        stack.enter_context(said_by("bridge"))
        stack.enter_context(watch_port(health, options.watch_port))
        settings = options.session(keys, robots, log)
        session = stack.enter_context(open_session(options.listen, settings))
        stack.enter_context(closing(inbox))
        ros_session = _open_ros(bridge.connect, opening, log, health)
        if ros_session is None:
            return
        ros = Ros(stack.enter_context(ros_session), bridge, odometry)
        world = LiveWorld(bridge, odometry, ros.put, log, epoch=epoch)
        stack.callback(world.stop)
        bus = Bus(session, keys, PublicScene(epoch=epoch, scene=bridge.scene()), robots, inbox)
        log.info(
            "bridge started",
            robots=len(robots),
            listen=options.listen,
            connect=bridge.connect,
            run=options.run,
            epoch=epoch,
        )
        health.up()
        driven = Run(world, RealTime(bridge.step_s), inbox, bus, log, health)
        driven.wait_for_robots(options.start_timeout)
        world.begin()
        driven.drive()
        health.ends()
        world.stop()
        log.info("robots stopped", refused_odometry=world.refused_odometry)
        bus.wait_for_readers()


def _open_ros(
    connect: str, opening: Opening, log: FilteringBoundLogger, health: WorldHealth
) -> zenoh.Session | None:
    """The session with the side of ROS, as soon as there is one; None if it is not wanted any more."""

    def tell_absence() -> None:
        log.warning("still waiting: there is no Zenoh router of ROS at this endpoint", connect=connect)

    log.info("waiting for the side of ROS", connect=connect)
    health.wants(f"it waits for the side of ROS at {connect}")
    try:
        opening.begin(client_session(connect))
        return opening.wait(health.beat, tell_absence)
    except zenoh.ZError as error:
        raise Refusal(
            f"the endpoint {connect} of the side of ROS cannot be used: {reason_of(error)}; that of its "
            "router is expected in 'connect', such as tcp/127.0.0.1:7447",
            ExitStatus.FAILED,
        ) from error


if __name__ == "__main__":
    run(main)
