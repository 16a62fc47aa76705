"""``python -m agent``: the command line of one robot's process."""

import functools
import math
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
import zenoh

from agent.check.command import check_device
from agent.check.findings import Device
from agent.estimate import DEFAULT_GOALS, GoalsName
from agent.process.health import RobotHealth
from agent.process.joining import SceneError
from agent.process.options import options_in
from agent.process.robot import MakeAgent, RobotOptions, RobotProcess, make_agent
from agent.process.warm import CompilingError
from agent.solve import ITERATIONS, SolverName
from agent.solve.orca import is_available
from chassis.healthy import HELP as WATCH_PORT_HELP
from chassis.healthy import VARIABLE as WATCH_PORT
from chassis.process import end_with_parent, log_to_journal, on_wish_to_end
from chassis.refusal import run as run_command
from chassis.refusal import said_by
from chassis.watching import watch_port as watched
from protocol.codec import MessageError
from protocol.device_keys import DeviceKeys
from protocol.identity import client_identity
from protocol.keys import checked_name
from protocol.scene import MAX_ROBOTS, Goal
from protocol.session import reason_of

NOT_READY = 1
FAILED = 3
ITERATIONS_HELP = "Most iterations of the real-time solver for one trajectory problem at one step."
GOALS_HELP = (
    "How robots come to know what the others will do: by goals, exchanged before the run or estimated, or by "
    "a baseline that asks for no goals."
)
BUDGET_HELP = "Milliseconds after which the real-time solver improves a decision no further."
ROBOTS = 8
ABOUT_THE_DEVICE = ("config", "check", "json", "robots")
"""Options that do not change how a robot drives."""


def _configured(context: typer.Context, path: Path | None) -> Path | None:
    """Take what the command line and the environment leave open from the file."""
    if path is not None:
        context.default_map = options_in(path)
    return path


def key_name(value: str) -> str:
    """A name that can stand in a key.

    Raises:
        typer.BadParameter: it cannot.
    """
    try:
        return checked_name(value)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def _goal(text: str) -> str:
    parse_goal(text)
    return text


def parse_goal(text: str) -> Goal:
    """A goal pose from ``x,y,heading`` in m, m and rad.

    Raises:
        typer.BadParameter: it is not three finite numbers of a plausible size.
    """
    try:
        x_m, y_m, heading_rad = (float(part) for part in text.split(","))
        return Goal(x_m=x_m, y_m=y_m, heading_rad=heading_rad)
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} found, x,y,heading is expected: three numbers in metres, metres and radians, "
            "such as 4,-4,-0.785"
        ) from None


def checked_goals(value: GoalsName) -> GoalsName:
    """A method that can be used here.

    Raises:
        typer.BadParameter: its library is not installed.
    """
    if value == "orca" and not is_available():
        raise typer.BadParameter(
            "orca needs the library pyrvo, which is not installed; in the clone, install it by "
            "pip install '.[orca]'"
        )
    return value


def checked_budget(value: float | None) -> float | None:
    """A time budget in ms.

    Raises:
        typer.BadParameter: it is negative or not finite.
    """
    if value is not None and not 0.0 <= value < math.inf:  # also refuses NaN
        raise typer.BadParameter(f"{value} found, a number of milliseconds that is not negative is expected")
    return value


def seconds(value_ms: float | None) -> float | None:
    """Milliseconds in s; None for none."""
    return None if value_ms is None else value_ms / 1000.0


def main(
    robot: Annotated[
        str,
        typer.Option(envvar="UNSPOKEN_ROBOT", callback=key_name, help="This robot's id in the scenario."),
    ],
    goal: Annotated[
        str,
        typer.Option(
            envvar="UNSPOKEN_GOAL",
            callback=_goal,
            help="Its own goal pose x,y,heading in m, m, rad. The environment hides it from process lists.",
        ),
    ],
    connect: Annotated[
        str, typer.Option(envvar="UNSPOKEN_CONNECT", help="Zenoh endpoint of the world.")
    ] = "tcp/127.0.0.1:7447",
    password_file: Annotated[
        Path | None,
        typer.Option(
            envvar="UNSPOKEN_PASSWORD_FILE",
            help="File with this robot's password, which only you can read.",
            show_default="none, for a world that asks for none",
        ),
    ] = None,
    keys: Annotated[
        Path | None,
        typer.Option(
            envvar="UNSPOKEN_KEYS",
            help="Folder with this robot's keys, as 'unspoken keys' makes it; for an endpoint tls/….",
            show_default="none",
        ),
    ] = None,
    run: Annotated[
        str,
        typer.Option(
            envvar="UNSPOKEN_RUN", callback=key_name, help="Name of the run, first part of all its keys."
        ),
    ] = "run",
    goals: Annotated[
        GoalsName,
        typer.Option(
            envvar="UNSPOKEN_GOALS",
            callback=checked_goals,
            help=GOALS_HELP,
        ),
    ] = DEFAULT_GOALS,
    solver: Annotated[
        SolverName,
        typer.Option(
            envvar="UNSPOKEN_SOLVER",
            help="What solves the trajectory problems.",
        ),
    ] = "realtime",
    iterations: Annotated[
        int,
        typer.Option(envvar="UNSPOKEN_ITERATIONS", min=1, help=ITERATIONS_HELP),
    ] = ITERATIONS,
    budget_ms: Annotated[
        float | None,
        typer.Option(
            envvar="UNSPOKEN_BUDGET_MS",
            callback=checked_budget,
            help=BUDGET_HELP,
            show_default="none, so that decisions do not depend on the clock",
        ),
    ] = None,
    watch_port: Annotated[
        int | None,
        typer.Option(envvar=WATCH_PORT, min=0, max=65535, help=WATCH_PORT_HELP, show_default="none"),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            envvar="UNSPOKEN_CONFIG",
            callback=_configured,
            is_eager=True,
            metavar="FILE",
            help="YAML file with any of these options; the command line and the environment go before it.",
            show_default="none",
        ),
    ] = None,
    check: Annotated[
        bool,
        typer.Option("--check", help="Say whether this device is ready, disturbing nobody, and end."),
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="With --check: tell it as JSON.")] = False,
    robots: Annotated[
        int,
        typer.Option(
            envvar="UNSPOKEN_ROBOTS",
            min=1,
            max=MAX_ROBOTS,
            help="With --check: how many robots to reckon with where no world tells.",
        ),
    ] = ROBOTS,
) -> None:
    """Be one robot: wait for a world, drive to the goal, until stopped by SIGINT or SIGTERM.

    Exit status: 0 stopped, 2 wrong usage, file, password or keys, 3 the world does not fit this robot or
    cannot be reached at all, or there is no place for the compiled solver, or the watch port is taken. With
    --check: 0 ready, 1 not, 2 wrong usage or file.
    """
    if check:
        device = Device(
            robot=robot,
            goal=parse_goal(goal),
            connect=connect,
            password_file=password_file,
            keys=keys,
            run=run,
            goals=goals,
            solver=solver,
            iterations=iterations,
            budget_s=seconds(budget_ms),
            robots=robots,
            config=config,
        )
        raise typer.Exit(0 if check_device(device, as_json=json) else NOT_READY)
    if json:
        raise typer.BadParameter("--json says how --check tells what it has found; give both")
    run_robot(
        make_agent,
        robot=robot,
        goal=goal,
        connect=connect,
        password_file=password_file,
        keys=keys,
        run=run,
        goals=goals,
        solver=solver,
        iterations=iterations,
        budget_ms=budget_ms,
        watch_port=watch_port,
    )


def command_line_of(make_agent: MakeAgent) -> Callable[..., None]:
    """The command line of a robot with a mind of this make, which is no matter of its device."""

    @functools.wraps(main)
    def command_line(**told: Any) -> None:
        run_robot(make_agent, **{name: each for name, each in told.items() if name not in ABOUT_THE_DEVICE})

    return command_line


def run_robot(
    make_agent: MakeAgent,
    *,
    robot: str,
    goal: str,
    connect: str,
    password_file: Path | None,
    keys: Path | None,
    run: str,
    goals: GoalsName,
    solver: SolverName,
    iterations: int,
    budget_ms: float | None,
    watch_port: int | None,
) -> None:
    """Be one robot with a mind of this make; the options are those of the command line.

    Raises:
        typer.Exit: the robot has failed; why was told.
    """
    end_with_parent()
    log_to_journal()
    now = datetime.now(UTC)
    with said_by(f"robot {robot}"):
        identity = client_identity(robot, connect, password_file, keys, now)
    options = RobotOptions(
        robot, parse_goal(goal), connect, identity, run, goals, solver, iterations, seconds(budget_ms)
    )
    if isinstance(identity, DeviceKeys) and (warning := identity.warning(now)):
        typer.echo(f"robot {robot}: {warning}", err=True)
    health = RobotHealth(robot, options.goal)
    process = RobotProcess(options, make_agent, health)
    on_wish_to_end(process.stop)
    try:
        with said_by(f"robot {robot}"), watched(health, watch_port):
            process.run()
    except (SceneError, MessageError, CompilingError) as error:
        typer.echo(f"robot {robot}: {error}", err=True)
        raise typer.Exit(FAILED) from None
    except zenoh.ZError as error:
        typer.echo(
            f"robot {robot}: the endpoint {connect} cannot be used: {reason_of(error)}; the one at which the "
            "world listens is expected in --connect, such as tcp/127.0.0.1:7447",
            err=True,
        )
        raise typer.Exit(FAILED) from None


if __name__ == "__main__":
    run_command(main)
