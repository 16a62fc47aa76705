"""The address of a run that is going on, left beside the run's output for its owner alone."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import structlog
from pydantic import ValidationError

from chassis.files import Record, write_private
from chassis.refusal import ExitStatus, Refusal
from protocol.keys import Name

FILE = ".reach.json"
RUNS = Path("runs")
"""Where ``unspoken run`` puts its runs unless told otherwise."""

log = structlog.get_logger("bench")


class Address(Record):
    """What it takes to listen to a run as its bench does."""

    endpoint: str
    run: Name
    """Its name on the bus."""
    password_file: Path | None
    """With the bench's password; None for a run without a policy."""


@contextmanager
def left_in(directory: Path, address: Address) -> Iterator[None]:
    """Leave it in a run's directory for as long as the block lasts; a run goes on without it, too."""
    path = directory / FILE
    try:
        path.unlink(missing_ok=True)
        write_private(path, address.model_dump_json())
    except OSError as error:
        log.warning("this run cannot be looked at by its directory", path=str(path), reason=error.strerror)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


def is_going_on(directory: Path) -> bool:
    """Whether the bench of a run has left it there, and has not ended in order since."""
    return (directory / FILE).exists()


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
