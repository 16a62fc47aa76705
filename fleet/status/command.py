"""``unspoken status``: its command line."""

import os
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.live import Live

from agent.process.options import key_name
from chassis.refusal import ExitStatus, Refusal
from fleet.interruption import Interruption
from fleet.record.address import Address, address_of, is_going_on, only_run
from fleet.status.listener import GoesOn, is_listened_at, listening
from fleet.status.standing import Status
from fleet.status.table import shown
from protocol.identity import Identity, client_identity
from protocol.keys import BENCH_NAME


def status(
    run_directory: Annotated[
        Path | None,
        typer.Argument(
            metavar="RUN",
            help="Directory of a run that is going on.",
            show_default="the only one that is going on in runs/",
        ),
    ] = None,
    connect: Annotated[
        str | None, typer.Option(help="Endpoint of the world, instead of RUN.", show_default=False)
    ] = None,
    run: Annotated[
        str,
        typer.Option(callback=key_name, help="With --connect: the run's name, as its world was given it."),
    ] = "run",
    password_file: Annotated[
        Path | None,
        typer.Option(help="With --connect: file with the bench's password.", show_default=False),
    ] = None,
    keys: Annotated[
        Path | None,
        typer.Option(help="With --connect: folder with the bench's keys.", show_default=False),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Listen for two seconds, print, and end.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON, one object per line, every half second or --once.")
    ] = False,
) -> None:
    """Show how the world and the robots of a run are doing, live, until it ends or you press Ctrl-C.

    Where the output is no terminal, it is shown --once, unless --json is given.

    Exit status: 0 it was shown, to the end or until you left; 1 there is no run to show, or it has ended
    without a verdict; 2 wrong usage, password or keys; 3 the world cannot be reached, or refuses.
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


def _local(directory: Path) -> tuple[Address, GoesOn]:
    """A run of this machine; a bench that was killed has not said that it has ended."""
    address = address_of(directory)
    if not is_listened_at(address.endpoint):
        raise Refusal(
            f"{directory}: this run has ended; its bench was ended without being able to say so",
            ExitStatus.UNMET,
        )

    def goes_on(status: Status) -> bool:
        return is_going_on(directory) and (status.world.state != "quiet" or is_listened_at(address.endpoint))

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
