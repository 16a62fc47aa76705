"""Devices to check."""

from agent.process.options import RobotOptions
from protocol.scene import Goal


def device(connect, **changes):
    return RobotOptions(
        **{"robot": "1", "goal": Goal(x_m=4.0, y_m=0.0, heading_rad=0.0), "goals": "ioc", **changes},
        connect=connect,
    )
