"""``python -m world.ros2``: the command line of the bridge to ROS 2."""

from pathlib import Path
from typing import Annotated

import typer

from chassis.process import end_with_parent, log_to_journal
from chassis.refusal import run as run_command
from chassis.refusal import said_by
from chassis.yaml_file import read_as
from world.access import Access, AccessError
from world.options import (
    InsecureOption,
    KeysOption,
    ListenOption,
    RunOption,
    StartTimeoutOption,
    UsersOption,
    WatchPortOption,
)
from world.process import EndpointError, ExitStatus
from world.ros2.process import BridgeOptions, run_bridge
from world.ros2.settings import Ros2Bridge
from world.run import RobotsMissingError


def main(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="BRIDGE",
            envvar="UNSPOKEN_BRIDGE",
            help="A file with the robots, their topics and the endpoint of the side of ROS.",
        ),
    ],
    listen: ListenOption = "tcp/127.0.0.1:7448",
    users: UsersOption = None,
    keys: KeysOption = None,
    insecure: InsecureOption = False,
    run: RunOption = "run",
    start_timeout: StartTimeoutOption = 60.0,
    watch_port: WatchPortOption = None,
) -> None:
    """Drive real robots: poses from ROS 2 odometry to the agents, their commands to ROS 2 as twists.

    It takes the place of a world until stopped by SIGINT or SIGTERM, and then tells all robots to stand.

    Exit status: 0 stopped, 2 wrong usage, file, passwords or keys, 3 agents were missing at the start or an
    endpoint or the watch port cannot be used.
    """
    end_with_parent()
    log_to_journal()
    settings = read_as(file, Ros2Bridge, "file of a bridge")
    access = Access(listen, users, keys, insecure)
    try:
        with said_by("bridge"):
            run_bridge(BridgeOptions(settings, access, run, start_timeout, watch_port))
    except AccessError as error:
        typer.echo(f"bridge: {error}", err=True)
        raise typer.Exit(ExitStatus.WRONG_USAGE) from None
    except (EndpointError, RobotsMissingError) as error:
        typer.echo(f"bridge: {error}", err=True)
        raise typer.Exit(ExitStatus.FAILED) from None


if __name__ == "__main__":
    run_command(main)
