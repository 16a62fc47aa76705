"""``unspoken keys``: the command line."""

from collections.abc import Callable, Iterable, Iterator
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
from fleet.keys import folders
from fleet.keys.authority import LOCAL_HOSTS, Device, checked_host
from fleet.keys.folders import AUTHORITY_FOLDER, Finding, devices_in, hosts_of_world, survey
from protocol.identity import date_text
from protocol.keys import BENCH_NAME, WORLD_NAME, checked_name
from protocol.scenario import load_scenario
from scenarios import find

MAX_DAYS = 36500

app = typer.Typer(
    cls=Group,
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Create, renew and check the keys that authenticate devices in runs across machines.\n\n"
    "Exit status: 0 done, 1 show found something wrong, 2 invalid usage or input, 3 the directory cannot be "
    "written.",
)


def _parser(check: Callable[[str], str]) -> Callable[[str], str]:
    def parsed(text: str) -> str:
        try:
            return check(text)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None

    return parsed


MadeArgument = Annotated[
    Path,
    typer.Argument(
        metavar="DIR", help="A directory made by unspoken keys create.", exists=True, file_okay=False
    ),
]
RobotOption = Annotated[
    list[str] | None,
    typer.Option(
        "--robot",
        metavar="ID",
        parser=_parser(checked_name),
        help="A robot's id; can be repeated.",
    ),
]
HostOption = Annotated[
    list[str] | None,
    typer.Option(
        "--host",
        metavar="HOST",
        parser=_parser(checked_host),
        help="Host name or IPv4 address at which robots reach the world; can be repeated.",
    ),
]
DaysOption = Annotated[
    int, typer.Option(min=1, max=MAX_DAYS, help="Validity of the devices' certificates, in days.")
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
        int, typer.Option(min=1, max=MAX_DAYS, help="Validity of the authority, in days.")
    ] = 3650,
) -> None:
    """Create an authority, and keys for the world, the bench and each robot: one folder per device.

    Without --host, the world can be reached only from its own machine.

    Exit status: 0 created, 2 invalid usage or scenario, or DIR is not empty, 3 DIR cannot be written; then
    nothing is left in it.
    """
    described = load_scenario(find(scenario)).robots if scenario else ()
    robots = dict.fromkeys([*(each.id for each in described), *(robot or ())])
    if not robots:
        raise typer.BadParameter("robots are expected: name a --scenario or each --robot")
    devices = [Device(WORLD_NAME, tuple(host or LOCAL_HOSTS)), Device(BENCH_NAME), *map(Device, robots)]
    now = _now()
    with _refusing_disk_errors(directory):
        folders.create(directory, devices, now, days, authority_days)
        _print(directory, survey(directory, now))
    typer.echo(
        f"Copy each folder to its device and nowhere else. Keep {directory / AUTHORITY_FOLDER} to yourself: "
        "whoever has it can make keys for anybody."
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
    """Renew the keys of the named devices, or create keys for new robots; without names, renew all.

    The authority stays the same. The world keeps its hosts unless --host names others.

    Exit status: 0 issued, 2 invalid usage, or the authority cannot be used, 3 DIR cannot be written.
    """
    named = [*[WORLD_NAME] * world, *[BENCH_NAME] * bench, *dict.fromkeys(robot or ())]
    now = _now()
    with _refusing_disk_errors(directory):
        names = named or devices_in(directory)
        if host and WORLD_NAME not in names:
            raise Refusal("--host is for the keys of the world, which are not among those named: add --world")
        devices = [Device(name) for name in names]
        if WORLD_NAME in names:
            devices[names.index(WORLD_NAME)] = Device(WORLD_NAME, tuple(host or hosts_of_world(directory)))
        folders.issue(directory, devices, now, days)
        issued = {directory / device.folder for device in devices}
        _print(directory, [found for found in survey(directory, now) if found.folder in issued])
    typer.echo("Copy each of these folders to its device, where it replaces any older one.")


@app.command()
def show(directory: MadeArgument) -> None:
    """List all certificates, their expiry dates and any problems; DIR can also be the folder of one device.

    Exit status: 0 all keys are valid, 1 something is wrong or expired, 2 invalid usage, or no keys found.
    """
    with _refusing_disk_errors(directory):
        found = survey(directory, _now())
    _print(directory, found)
    for text in filter(None, (finding.wrong or finding.warning for finding in found)):
        typer.echo(text)
    if any(finding.wrong for finding in found):
        raise typer.Exit(ExitStatus.UNMET)


def _now() -> datetime:
    return datetime.now(UTC).replace(microsecond=0)  # certificates know no parts of a second


@contextmanager
def _refusing_disk_errors(directory: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        where = error.filename or directory  # a full disk does not name the file
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
