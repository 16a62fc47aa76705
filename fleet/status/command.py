"""``unspoken status``: its command line."""

import os
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from rich.console import Console

from agent.process.options import key_name
from fleet.interruption import Interruption
from fleet.record.address import Address, NoRunError, address_of, is_going_on, only_run
from fleet.status.listener import UnreachableError, is_listened_at, listening
from fleet.status.standing import Status
from fleet.status.table import Follower, follow_live, shown
from protocol.identity import Identity, client_identity
from protocol.keys import BENCH_NAME

NO_RUN, WRONG_USAGE, UNADDRESSABLE = 1, 2, 3


def status(
    run_directory: Annotated[
        Path | None,
        typer.Argument(
            metavar="[RUN]",
            help="Directory of a run that is going on.",
            show_default="the only one that is going on in runs/",
        ),
    ] = None,
    connect: Annotated[
        str | None, typer.Option(help="Endpoint of a world, instead of RUN.", show_default="none")
    ] = None,
    run: Annotated[
        str,
        typer.Option(callback=key_name, help="With --connect: name of the run, as its world is told it."),
    ] = "run",
    password_file: Annotated[
        Path | None,
        typer.Option(help="With --connect: file with the bench's password.", show_default="none"),
    ] = None,
    keys: Annotated[
        Path | None,
        typer.Option(help="With --connect: folder with the bench's keys.", show_default="none"),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Look for two seconds, print once, and end.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON, an object a line; without --once every half second.")
    ] = False,
) -> None:
    """Show how the world and the robots of a run are, live, until it ends or you press Ctrl-C.

    Where the output is no terminal, --once is taken as given, unless there is --json.

    Exit status: 0 it was shown, to the end or until you left; 1 there is no run to show, or it has ended
    without a verdict; 2 wrong usage, password or keys; 3 the world cannot be reached, or refuses.
    """
    try:
        if connect is None:
            directory = run_directory or only_run()
            address = _lasting(directory)
            password_file = address.password_file
            goes_on: Callable[[Status], bool] = partial(_goes_on, directory, address.endpoint)
        else:
            address, goes_on = Address(endpoint=connect, run=run, password_file=password_file), _always
        identity = client_identity(BENCH_NAME, address.endpoint, password_file, keys, datetime.now(UTC))
        ended = _show(address, identity, goes_on, once=once, as_json=as_json)
    except NoRunError as error:
        _fail(error, NO_RUN)
    except UnreachableError as error:
        _fail(error, UNADDRESSABLE)
    except KeyboardInterrupt:
        return
    except BrokenPipeError:  # whoever reads has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return
    if not ended:
        _fail("the run has ended without a verdict", NO_RUN)


def _show(
    address: Address, identity: Identity, goes_on: Callable[[Status], bool], *, once: bool, as_json: bool
) -> bool:
    """Show it as is wanted; False where the run has ended without a verdict."""
    console = Console(highlight=False)
    with (
        Interruption() as interruption,
        listening(address.endpoint, identity, address.run, interruption) as listener,
    ):
        follower = Follower(listener, interruption, goes_on)
        if as_json and not once:
            return follower.follow(_print_json)
        if console.is_terminal and not once:
            return follow_live(follower, console)
        status = follower.once()
        if as_json:
            _print_json(status)
        else:
            console.print(shown(status, console.width, None))
        return True


def _print_json(status: Status) -> None:
    print(status.model_dump_json(), flush=True)


def _lasting(directory: Path) -> Address:
    """How a run is reached whose world is there."""
    address = address_of(directory)
    if not is_listened_at(address.endpoint):
        raise NoRunError(f"{directory}: this run has ended; its bench was ended without being able to say so")
    return address


def _goes_on(directory: Path, endpoint: str, status: Status) -> bool:
    """Whether a run of this machine does; a bench that was killed has not said that it does not."""
    return is_going_on(directory) and (status.world.state != "quiet" or is_listened_at(endpoint))


def _always(_status: Status) -> bool:
    """A world elsewhere may come back."""
    return True


def _fail(why: object, exit_status: int) -> NoReturn:
    typer.echo(f"unspoken: {why}", err=True)
    raise typer.Exit(exit_status)
