"""``python -m agent``: the command line of one robot's process."""

from pathlib import Path
from typing import Annotated

import typer

from agent.check.device import check_device
from agent.process.options import RobotOptions, options_in
from agent.process.robot import run_robot
from chassis.options import with_options
from chassis.refusal import ExitStatus, run


def _configured(context: typer.Context, path: Path | None) -> Path | None:
    """Take what the command line and the environment leave open from the file."""
    if path is not None:
        context.default_map = options_in(path)
    return path


@with_options(environment=True)
def main(
    options: RobotOptions,
    config: Annotated[
        Path | None,
        typer.Option(
            envvar="UNSPOKEN_CONFIG",
            callback=_configured,
            is_eager=True,
            metavar="FILE",
            help="YAML file with any of these options; the command line and the environment take precedence.",
            show_default="none",
        ),
    ] = None,
    check: Annotated[
        bool,
        typer.Option(
            "--check", help="Check whether this device is ready, without disturbing a run, and exit."
        ),
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="With --check: report as JSON.")] = False,
) -> None:
    """Run one robot: wait for a world and drive to the goal, until stopped by SIGINT or SIGTERM.

    Exit status: 0 stopped, 2 invalid usage, file, password or keys, 3 the world does not fit this robot or
    speaks another version of the protocol, the endpoint is unusable, the compiled solver cannot be stored,
    or the watch port is taken. With --check: 0 ready, 1 not ready, 2 invalid usage or file.
    """
    if json and not check:
        raise typer.BadParameter("--json says how --check reports what it has found; give both")
    if not check:
        run_robot(options)
    elif not check_device(options, config, as_json_text=json):
        raise typer.Exit(ExitStatus.UNMET)


if __name__ == "__main__":
    run(main)
