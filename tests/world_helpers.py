"""Scenarios and commands that the tests of the world share."""

from typing import Any

from protocol.keys import Keys
from protocol.messages import Command
from protocol.scenario import Pose, Scenario, ScenarioRobot, Sensing
from protocol.vehicle import Limits
from world.vehicle import VehicleState

EPOCH = 7
KEYS = Keys("run")
PATIENCE_S = 60.0
"""How long a test waits for what should come; only reached when it fails."""
SPRINT_STEPS = 20
"""Steps in which `sprint` covers one metre, from standstill to standstill."""
NIMBLE = Limits(jerk_mps3=100.0, turn_acceleration_radps2=100.0)
"""No rate limit stands in the way of a test's commands."""


def lanes(
    count: int,
    *,
    length_m: float = 1.0,
    spacing_m: float = 2.0,
    limits: Limits = NIMBLE,
    sensing: Sensing | None = None,
    **rules: Any,
) -> Scenario:
    """Robots 1, 2, … side by side, each with its goal straight ahead along x."""
    robots = [
        ScenarioRobot(
            id=str(index + 1),
            start=Pose(x_m=0.0, y_m=index * spacing_m),
            goal=Pose(x_m=length_m, y_m=index * spacing_m),
            limits=limits,
        )
        for index in range(count)
    ]
    return Scenario(name="lanes", robots=robots, sensing=sensing or Sensing(), **rules)


def sprint(step: int) -> float:
    """Acceleration in m/s²: 1 for ten steps of 0.1 s, −1 for ten more: Δt²·10² = 1 m (Euler sums)."""
    if step >= SPRINT_STEPS:
        return 0.0
    return 1.0 if step < SPRINT_STEPS // 2 else -1.0


def command(
    robot: str,
    step: int,
    acceleration_mps2: float = 0.0,
    turn_rate_radps: float = 0.0,
    **more: Any,
) -> Command:
    inputs = {"turn_rate_radps": turn_rate_radps, "acceleration_mps2": acceleration_mps2}
    return Command(**{"epoch": EPOCH, "robot": robot, "step": step, **inputs, **more})


def at(x_m: float, y_m: float, heading_rad: float = 0.0, speed_mps: float = 0.0) -> VehicleState:
    return VehicleState(x_m, y_m, heading_rad, speed_mps)
