"""The command line ``unspoken``: where its commands are, of which each is imported when it is called."""

from chassis.commands import lazy_app
from protocol.version import version_text

COMMANDS = {
    "run": ("fleet.run.command:run", "Run a scenario in real processes."),
    "simulate": ("fleet.run.command:simulate", "Run a scenario in virtual time, in this one process."),
    "world": ("world.__main__:main", "Simulate and referee one run."),
    "agent": ("agent.__main__:main", "Be one robot, or check whether this device can be one."),
    "status": ("fleet.status.command:status", "Show how the world and the robots of a run are, live."),
    "bridge": ("fleet.cli:bridge", "Let real robots take the place of simulated ones."),
    "bench": ("fleet.bench.command:bench", "Measure how fast and how good decisions are here."),
    "scenarios": (
        "fleet.scenarios.command:app",
        "List bundled scenarios and suites, or generate some.",
    ),
    "keys": ("fleet.keys.command:app", "Make, renew and check the keys of devices."),
    "evaluate": ("fleet.evaluate.command:evaluate", "Compare methods over a suite of scenarios."),
    "report": ("fleet.report.command:report", "Make a page of an evaluation, with figures."),
    "faults": ("fleet.faults.command:faults", "Let things break, and check what has to hold."),
    "audit": ("fleet.audit.command:audit", "Show that robots decided on their own observations."),
    "replay": ("fleet.audit.command:replay", "Let a robot of a recorded run decide again."),
}
"""By name: the function or the app, and a line of help."""

app = lazy_app("Mobile robots that cross each other's way without communicating.", COMMANDS, version_text)
bridge = lazy_app(
    "Real robots in place of simulated ones.",
    {"ros2": ("world.ros2.__main__:main", "Drive real robots through ROS 2.")},
)
