"""Devices to check."""

from agent.check.findings import Device
from protocol.scene import Goal


def device(connect, **changes):
    told = {
        "robot": "1",
        "goal": Goal(x_m=4.0, y_m=0.0, heading_rad=0.0),
        "password_file": None,
        "keys": None,
        "run": "run",
        "goals": "ioc",
        "solver": "realtime",
        "iterations": 2,
        "budget_s": None,
        "robots": 8,
        "config": None,
    }
    return Device(connect=connect, **(told | changes))
