"""``unspoken audit`` and ``unspoken replay``: the command lines."""

from pathlib import Path
from typing import Annotated

import typer

from fleet.record.report_file import JsonOption

RunArgument = Annotated[
    Path,
    typer.Argument(
        metavar="RUN", help="The output directory of unspoken run or simulate, or the run.mcap in it."
    ),
]


def audit(run: RunArgument, json: JsonOption = None) -> None:
    """Show from a recording that each robot decided on its own observations and the scene alone.

    The world is repeated with the recorded commands and must show every robot what was recorded; each robot
    is repeated with its own recorded observations and must decide what was recorded. All of it bit for bit.
    Takes as long as deciding took; Ctrl-C ends it. docs/auditing.md tells what this shows and what it cannot.

    Exit status: 0 everything follows; 1 something does not, or interrupted; 2 wrong usage, or not a
    recording; 3 the run cannot be repeated on this machine, or the report cannot be written.
    """
    from fleet.audit.conducting import conduct_audit

    raise typer.Exit(conduct_audit(run, json))


def replay(
    run: RunArgument,
    robot: Annotated[str, typer.Option(help="The robot's id.")],
    steps: Annotated[bool, typer.Option("--steps", help="Show each decision in a line.")] = False,
    debug_at: Annotated[
        int | None,
        typer.Option(min=0, metavar="STEP", help="Enter Python's debugger just before this step's decision."),
    ] = None,
) -> None:
    """Repeat the decisions of one robot of a recorded run, and compare them with the recorded ones.

    Ctrl-C ends it.

    Exit status: 0 all are the same, bit for bit; 1 they are not, or interrupted; 2 wrong usage, no such robot
    or step, or not a recording; 3 the run cannot be repeated on this machine.
    """
    from fleet.audit.conducting import conduct_replay

    raise typer.Exit(conduct_replay(run, robot, steps=steps, debug_at=debug_at))
