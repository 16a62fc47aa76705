"""The command line ``unspoken``: where its commands are, of which each is imported when it is called."""

from chassis.commands import lazy_app
from protocol.version import version_text

COMMANDS = {
    "run": ("fleet.run.command:run", "Run a scenario in real processes."),
    "simulate": ("fleet.run.command:simulate", "Run a scenario in virtual time, in a single process."),
    "world": ("world.__main__:main", "Simulate and referee one run."),
    "agent": ("agent.__main__:main", "Run one robot, or check whether this device is ready to."),
    "status": ("fleet.status.command:status", "Show the state of a run live."),
    "bridge": ("fleet.cli:bridge", "Connect real robots in place of simulated ones."),
    "bench": ("fleet.bench.command:bench", "Measure the speed and quality of decisions on this machine."),
    "scenarios": ("fleet.scenarios.command:app", "List bundled scenarios and suites, or generate a suite."),
    "keys": ("fleet.keys.command:app", "Create, renew and check the keys of devices."),
    "evaluate": ("fleet.evaluate.command:evaluate", "Compare methods over a suite of scenarios."),
    "report": ("fleet.report.command:report", "Write the HTML report of an evaluation."),
    "faults": ("fleet.faults.command:faults", "Inject faults and check that the guarantees hold."),
    "hunt": ("fleet.hunt.command:hunt", "Search for the scenarios that hurt robots most."),
    "audit": ("fleet.audit.command:audit", "Verify that robots decided on their own observations only."),
    "replay": ("fleet.audit.command:replay", "Replay the decisions of one robot of a recorded run."),
}
"""By name: the function or the app, and a line of help."""

app = lazy_app("Mobile robots that cross each other's paths without communicating.", COMMANDS, version_text)
bridge = lazy_app(
    "Connect real robots in place of simulated ones.",
    {"ros2": ("world.ros2.__main__:main", "Connect real robots through ROS 2.")},
)
