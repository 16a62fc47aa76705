"""A program: get the solver ready as a robot does, decide among four robots, and print that as JSON."""

import json
import math
import platform
import time

import numpy as np

import agent.process.robot  # what a robot's process imports
from agent.estimate import DEFAULT_GOALS
from agent.process.options import DecisionOptions
from agent.process.warm import warm_up
from agent.solve.compiled import forbid_compiling
from agent.solve.vehicle import rollout
from protocol.messages import Observation, State
from protocol.scene import Goal, PublicRobot, Scene

STEPS = 8
"""Robots have driven for so long; then one decides."""
SPEED_MPS = 0.8
DISTANCE_M = 3.0
SCENE = Scene(robots={str(robot): PublicRobot() for robot in range(1, 5)})
GOAL = Goal(x_m=DISTANCE_M, y_m=0.0, heading_rad=0.0)


def observations() -> list[Observation]:
    """What the robots show: all drive towards the middle, each turning a little."""
    tracks = {}
    for turn, robot in enumerate(SCENE.robots):
        heading_rad = turn * math.pi / 2.0
        x_m, y_m = -DISTANCE_M * math.cos(heading_rad), -DISTANCE_M * math.sin(heading_rad)
        inputs = np.tile([0.05 * turn, 0.1], (STEPS, 1))
        tracks[robot] = rollout(np.array([x_m, y_m, heading_rad, SPEED_MPS]), inputs, SCENE.step_s)
    return [
        Observation(
            epoch=0,
            step=step,
            time_s=step * SCENE.step_s,
            robots={robot: State.of(*track[step].tolist()) for robot, track in tracks.items()},
        )
        for step in range(STEPS + 1)
    ]


def main() -> None:
    """Compile what a robot needs that is told nothing else, and decide without compiling anything more."""
    compiled_s = warm_up(DEFAULT_GOALS, "realtime")
    forbid_compiling()
    robot = DecisionOptions().agent("1", GOAL, SCENE, time.perf_counter)
    for observation in observations():
        begin_s = time.perf_counter()
        decision = robot.decide(observation)
        decision_s = time.perf_counter() - begin_s
    command, mind = decision.command, decision.mind
    told = {
        "machine": platform.machine(),
        "process": agent.process.__name__,
        "compiled_s": compiled_s,
        "decision_s": decision_s,
        "failed": mind.failed,
        "command": [command.turn_rate_radps, command.acceleration_mps2],
        "estimates": {name: [state.x_m, state.y_m] for name, state in sorted(mind.estimates.items())},
    }
    print(json.dumps(told))


if __name__ == "__main__":
    main()
