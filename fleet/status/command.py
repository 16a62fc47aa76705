"""``unspoken status``: finds a run that is going on, and shows it in a table that fits the terminal."""

import os
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import typer
from pydantic import ValidationError
from rich.console import Console, Group, JustifyMethod, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from agent.process.options import key_name
from chassis.refusal import ExitStatus, Refusal
from fleet.interruption import Interruption
from fleet.run.launch import FILE, Address
from fleet.status.listener import GoesOn, is_listened_at, listening
from fleet.status.standing import RobotState, RobotStatus, Spread, Status, WorldStatus
from protocol.identity import Identity, client_identity
from protocol.keys import BENCH_NAME

RUNS = Path("runs")
"""Where ``unspoken run`` puts its runs unless told otherwise."""


def status(
    run_directory: Annotated[
        Path | None,
        typer.Argument(
            metavar="RUN",
            help="Directory of a run in progress.",
            show_default="the only run in progress in runs/",
        ),
    ] = None,
    connect: Annotated[
        str | None, typer.Option(help="Endpoint of the world, instead of RUN.", show_default=False)
    ] = None,
    run: Annotated[
        str,
        typer.Option(callback=key_name, help="With --connect: name of the run, as given to its world."),
    ] = "run",
    password_file: Annotated[
        Path | None,
        typer.Option(help="With --connect: file with the bench's password.", show_default=False),
    ] = None,
    keys: Annotated[
        Path | None,
        typer.Option(help="With --connect: folder with the bench's keys.", show_default=False),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Listen for two seconds, print, and exit.")] = False,
    as_json: Annotated[
        bool,
        typer.Option(
            "--json", help="Print JSON, one object per line, every half second (or once, with --once)."
        ),
    ] = False,
) -> None:
    """Show the state of the world and the robots of a run live, until it ends or you press Ctrl-C.

    If the output is not a terminal, --once is implied, unless --json is given.

    Exit status: 0 shown to the end or until you stopped it; 1 no run to show, or it ended without a verdict;
    2 invalid usage, password or keys; 3 the world cannot be reached, or refuses the connection.
    """
    try:
        if connect is None:
            directory = run_directory or only_run()
            address, goes_on = _local(directory)
        else:
            address = Address(endpoint=connect, run=run, password_file=password_file)
            goes_on = _may_come_back
        identity = client_identity(
            BENCH_NAME, address.endpoint, address.password_file, keys, datetime.now(UTC)
        )
        ended = _show(address, identity, goes_on, once=once, as_json=as_json)
    except KeyboardInterrupt:
        return
    except BrokenPipeError:  # whoever reads has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return
    if not ended:
        raise Refusal("the run has ended without a verdict", ExitStatus.UNMET)


def address_of(directory: Path) -> Address:
    """How the run of this directory is reached.

    Raises:
        Refusal: none goes on there.
    """
    path = directory / FILE
    try:
        return Address.model_validate_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        what = "this run has ended" if directory.is_dir() else "there is no such directory"
        text = f"{directory}: {what}; the directory of a run that is going on is expected"
    except (OSError, UnicodeDecodeError, ValidationError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not what a run leaves there"
        text = f"{path}: cannot be read: {reason}"
    raise Refusal(text, ExitStatus.UNMET)


def only_run(runs: Path = RUNS) -> Path:
    """The directory of the run that is going on, where there is exactly one.

    Raises:
        Refusal: there is none, or more than one.
    """
    found = sorted(path.parent for path in runs.glob(f"*/{FILE}"))
    if len(found) == 1:
        return found[0]
    text = f"{len(found)} runs are going on: {', '.join(map(str, found))}; name one of them"
    if not found:
        text = (
            f"no run is going on in {runs}/; name the directory of one, or the endpoint of its world "
            "with --connect"
        )
    raise Refusal(text, ExitStatus.UNMET)


def _local(directory: Path) -> tuple[Address, GoesOn]:
    """A run of this machine; a bench that was killed has not said that it has ended."""
    address = address_of(directory)
    if not is_listened_at(address.endpoint):
        raise Refusal(
            f"{directory}: this run has ended; its bench was ended without being able to say so",
            ExitStatus.UNMET,
        )

    def goes_on(status: Status) -> bool:
        is_left = (directory / FILE).exists()
        return is_left and (status.world.state != "quiet" or is_listened_at(address.endpoint))

    return address, goes_on


def _may_come_back(_status: Status) -> bool:
    """A world elsewhere may."""
    return True


def _show(address: Address, identity: Identity, goes_on: GoesOn, *, once: bool, as_json: bool) -> bool:
    """Show it in the way that is wanted; False where the run has ended without a verdict."""
    console = Console(highlight=False)
    with Interruption() as interruption, listening(address, identity, interruption) as listener:
        if as_json and not once:
            return listener.follow(goes_on, _print_json)
        if console.is_terminal and not once:
            with Live(console=console, auto_refresh=False) as live:

                def show(status: Status) -> None:
                    live.update(shown(status, console.width, console.height), refresh=True)

                return listener.follow(goes_on, show)
        status = listener.look()
    if as_json:
        _print_json(status)
    else:
        console.print(shown(status, console.width, None))
    return True


def _print_json(status: Status) -> None:
    print(status.model_dump_json(), flush=True)


COLOURS: Final[dict[RobotState, str]] = {
    "lost": "red",
    "quiet": "red",
    "missing": "yellow",
    "degraded": "yellow",
    "present": "",
    "ready": "green",
    "arrived": "cyan",
}
"""First the states that need attention first."""
AROUND: Final = 6
"""Lines that are no robot's."""
MEDIUM: Final = 56
WIDE: Final = 96


def shown(status: Status, width: int, height: int | None) -> RenderableType:
    """As much of the status as fits a terminal of so many columns and lines; None: of any number of lines."""
    robots = list(status.robots)
    room = len(robots) if height is None else max(height - AROUND, 1)
    if len(robots) > room:
        order = list(COLOURS)
        robots.sort(key=lambda robot: order.index(robot.state))
    table = Table(box=None, pad_edge=False, header_style="bold")
    columns = [column for column in COLUMNS if width >= column.from_width]
    for column in columns:
        table.add_column(column.header, justify=column.justify, no_wrap=bool(column.header))
    for robot in robots[:room]:
        table.add_row(*(column.cell(robot) for column in columns))
    lines: list[RenderableType] = [Text(_world(status.world), overflow="fold"), table]
    if hidden := [robot.state for robot in robots[room:]]:
        counts = ", ".join(f"{hidden.count(state)} {state}" for state in COLOURS if state in hidden)
        lines.append(Text(f"and {len(hidden)} more: {counts}", style="dim"))
    return Group(*lines)


def _world(world: WorldStatus) -> str:
    if world.step is None:
        return "world waits for robots"
    state = f"ended: {world.verdict}" if world.verdict else world.state
    parts = [f"world {state}", f"step {world.step}", f"{world.time_s:.1f} s"]
    parts += [f"{_number(world.rate_hz)} steps/s", f"{world.arrived} arrived"]
    if world.minimum_distance_m is not None:
        parts.append(f"closest {world.minimum_distance_m:.2f} m")
    if world.collisions:
        parts.append(f"{world.collisions} collided")
    return " · ".join(parts)


def _remarks(robot: RobotStatus) -> str:
    counts = {
        "solver failures": robot.solver_failures,
        "interventions": robot.interventions,
        "refused": robot.refused,
    }
    return ", ".join([*robot.degraded, *(f"{count} {what}" for what, count in counts.items() if count)])


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}"


def _spread(spread: Spread | None) -> str:
    return "–" if spread is None else f"{spread.p50:.1f} / {spread.p99:.1f}"


class Column(NamedTuple):
    """One column of the robots' table."""

    header: str
    cell: Callable[[RobotStatus], str | Text]
    from_width: int = 0
    """Of the terminal; a narrower one does without."""
    justify: JustifyMethod = "right"


COLUMNS: Final = (
    Column("robot", lambda robot: robot.robot, justify="left"),
    Column("state", lambda robot: Text(robot.state, style=COLOURS[robot.state]), justify="left"),
    Column("step", lambda robot: "–" if robot.step is None else str(robot.step)),
    Column("decisions/s", lambda robot: _number(robot.rate_hz), MEDIUM),
    Column("decide ms", lambda robot: _spread(robot.decide_ms), MEDIUM),
    Column("lag ms", lambda robot: _spread(robot.lag_ms), MEDIUM),
    Column("missed", lambda robot: str(robot.missed), WIDE),
    Column("", _remarks, WIDE, justify="left"),
)
