"""``python hanging.py agent|world``: such a process, as started by its own module, that hangs at step 3.

Its loop is then stuck in the middle of a step, while all its other threads go on.
"""

import runpy
import sys
import threading
from collections.abc import Callable
from typing import Any

import chassis.health
from agent.agent import Agent
from world.world import World

STEP = 3


def hanging(go_on: Callable[..., Any], is_there: Callable[..., bool]) -> Callable[..., Any]:
    """A method that hangs once the run is there."""

    def method(*arguments: Any) -> Any:
        if is_there(*arguments):
            threading.Event().wait()
        return go_on(*arguments)

    return method


if __name__ == "__main__":
    chassis.health.LONGEST_SILENCE_S = 1.0  # so that the test need not wait for ten
    # Epoch 0 is that of the decisions for which kernels are loaded, before there is a run.
    Agent.decide = hanging(Agent.decide, lambda _agent, seen: seen.epoch > 0 and seen.step >= STEP)
    World.advance = hanging(World.advance, lambda world, _commands: world.step >= STEP)
    runpy.run_module(sys.argv.pop(1), run_name="__main__", alter_sys=True)
