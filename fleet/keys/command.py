"""``unspoken keys``: the command line."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from chassis.refusal import ExitStatus, Group, Refusal
from fleet.keys.authority import LOCAL_HOSTS, Device, Host
from fleet.keys.folders import AUTHORITY_FOLDER, devices_in, hosts_of_world
from fleet.keys.folders import create as create_keys
from fleet.keys.folders import issue as issue_keys
from fleet.keys.survey import Finding, survey
from protocol.device_keys import date_text
from protocol.keys import BENCH_NAME, WORLD_NAME, checked_name
from protocol.scenario import load_scenario
from scenarios import find

MAX_DAYS = 36500

app = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    help="Make, renew and look through the keys with which devices prove who they are, for runs across "
    "machines.\n\nExit status: 0 done, 1 show found something wrong, 2 wrong usage or input, 3 the directory "
    "cannot be written.",
)


def _robots(values: list[str] | None) -> list[str]:
    try:
        return [checked_name(value) for value in values or ()]
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def _host(text: str) -> Host:
    try:
        return Host.parse(text)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


MadeArgument = Annotated[
    Path,
    typer.Argument(
        metavar="DIR", help="A directory made by unspoken keys create.", exists=True, file_okay=False
    ),
]
RobotOption = Annotated[
    list[str] | None,
    typer.Option("--robot", metavar="ID", callback=_robots, help="A robot's id; may be given several times."),
]
HostOption = Annotated[
    list[Host] | None,
    typer.Option(
        "--host",
        metavar="HOST",
        parser=_host,
        help="Name or IPv4 address by which robots reach the world; may be given several times.",
    ),
]
DaysOption = Annotated[
    int, typer.Option(min=1, max=MAX_DAYS, help="For which the devices' certificates are valid.")
]


@app.command()
def create(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="Directory for the keys, new or empty.", file_okay=False)
    ],
    scenario: Annotated[
        str | None,
        typer.Option(help="Keys for the robots of this scenario: a file, or a bundled one such as 8a."),
    ] = None,
    robot: RobotOption = None,
    host: HostOption = None,
    days: DaysOption = 365,
    authority_days: Annotated[
        int, typer.Option(min=1, max=MAX_DAYS, help="For which their authority is valid.")
    ] = 3650,
) -> None:
    """Make an authority, and keys for the world, the bench and each robot: a folder for each device.

    Without --host the world can be reached on its own machine only.

    Exit status: 0 made, 2 wrong usage or scenario, or DIR is not empty, 3 DIR cannot be written; nothing is
    left in it then.
    """
    robots = dict.fromkeys([*(_ids(scenario) if scenario else ()), *(robot or ())])
    if not robots:
        raise typer.BadParameter("robots are expected: name a --scenario or each --robot")
    devices = [Device(WORLD_NAME, tuple(host or LOCAL_HOSTS)), Device(BENCH_NAME), *map(Device, robots)]
    now = _now()
    with _told(directory):
        create_keys(directory, devices, now, days, authority_days)
        _print(directory, survey(directory, now))
    typer.echo(
        f"Copy each folder to its device and nowhere else. Keep {directory / AUTHORITY_FOLDER} to yourself: "
        "who has it can make keys for everybody."
    )


@app.command()
def issue(
    directory: MadeArgument,
    robot: RobotOption = None,
    world: Annotated[bool, typer.Option("--world", help="Keys for the world.")] = False,
    bench: Annotated[bool, typer.Option("--bench", help="Keys for the bench.")] = False,
    host: HostOption = None,
    days: DaysOption = 365,
) -> None:
    """Renew keys, or add some for other robots; without a name those of every device in DIR are renewed.

    The authority stays. The world keeps its hosts unless --host names others.

    Exit status: 0 issued, 2 wrong usage, or the authority cannot be used, 3 DIR cannot be written.
    """
    named = [*([WORLD_NAME] if world else ()), *([BENCH_NAME] if bench else ()), *dict.fromkeys(robot or ())]
    now = _now()
    with _told(directory):
        names = named or devices_in(directory)
        if host and WORLD_NAME not in names:
            raise Refusal("--host is for the keys of the world, which are not among the named: add --world")
        issue_keys(directory, [_device(directory, name, host) for name in names], now, days)
        issued = {directory / Device(name).folder for name in names}
        _print(directory, (found for found in survey(directory, now) if found.folder in issued))
    typer.echo("Copy each of these folders to its device, in the place of an older one.")


@app.command()
def show(directory: MadeArgument) -> None:
    """Show who has which certificate, until when, and what is wrong; DIR may be one device's folder too.

    Exit status: 0 all is well, 1 something is wrong or expired, 2 wrong usage, or no keys are there.
    """
    with _told(directory):
        found = survey(directory, _now())
    _print(directory, found)
    for finding in found:
        if finding.wrong or finding.warning:
            typer.echo(finding.wrong or finding.warning)
    if any(finding.wrong for finding in found):
        raise typer.Exit(ExitStatus.UNMET)


def _device(directory: Path, name: str, hosts: Sequence[Host] | None) -> Device:
    if name != WORLD_NAME:
        return Device(name)
    return Device(name, tuple(hosts or hosts_of_world(directory)))


def _ids(scenario: str) -> list[str]:
    return [robot.id for robot in load_scenario(find(scenario)).robots]


def _now() -> datetime:
    return datetime.now(UTC).replace(microsecond=0)  # certificates know no parts of a second


@contextmanager
def _told(directory: Path) -> Iterator[None]:
    """Errors of the disk in plain words."""
    try:
        yield
    except OSError as error:
        where = error.filename or directory  # a full disk does not tell the file
        raise Refusal(f"{where}: cannot be used: {error.strerror}", ExitStatus.FAILED) from None


def _print(directory: Path, findings: Iterable[Finding]) -> None:
    """One row a folder, named as seen from the directory."""
    table = Table(box=box.SIMPLE_HEAD)
    for header in ("Who", "Folder", "Expires", "State"):
        table.add_column(header, overflow="fold")
    for finding in findings:
        state = "[red]wrong[/]" if finding.wrong else "[yellow]soon[/]" if finding.warning else "ok"
        expires = date_text(finding.expires) if finding.expires else "–"
        table.add_row(finding.holder, Text(str(finding.folder.relative_to(directory))), expires, state)
    Console(highlight=False).print(table)
