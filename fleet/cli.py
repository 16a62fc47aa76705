"""The command line ``unspoken``."""

import typer

import agent.__main__
import world.__main__
import world.ros2.__main__
from agent.cli import VersionOption
from chassis.refusal import Group
from fleet.audit.command import audit, replay
from fleet.bench.command import bench
from fleet.evaluate.command import evaluate
from fleet.faults.command import faults
from fleet.keys.command import app as keys
from fleet.report.command import report
from fleet.run.command import run, simulate
from fleet.scenarios.command import app as scenarios
from fleet.status.command import status

app = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Mobile robots that cross each other's way without communicating.",
)

bridge = typer.Typer(no_args_is_help=True, help="Real robots in place of simulated ones.")
bridge.command("ros2")(world.ros2.__main__.main)


@bridge.callback()
def _bridges() -> None:
    """With a single command in it, this keeps the command's name."""


app.command("run")(run)
app.command("simulate")(simulate)
app.command("world")(world.__main__.main)
app.command("agent")(agent.__main__.main)
app.command("status")(status)
app.add_typer(bridge, name="bridge")
app.command("bench")(bench)
app.add_typer(scenarios, name="scenarios")
app.add_typer(keys, name="keys")
app.command("evaluate")(evaluate)
app.command("report")(report)
app.command("faults")(faults)
app.command("audit")(audit)
app.command("replay")(replay)


@app.callback()
def _options(_version: VersionOption = False) -> None:
    """Options of the command itself."""
