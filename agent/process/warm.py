"""Kernels made ready before they are needed: compiled once on a machine, loaded by each process.

``python -m agent.process.warm`` compiles them for whoever starts later: while an image is built, or on a new
device.
"""

import fcntl
import signal
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from agent.estimate import GoalsName
from agent.process.options import DecisionOptions
from agent.remember.perception import REACQUIRED_AFTER
from agent.solve import SolverName
from agent.solve.compiled import FOLDER, is_complete, is_writable, mark_complete, places
from agent.solve.vehicle import rollout
from chassis.lean import hidden
from chassis.refusal import ExitStatus, Refusal
from protocol.messages import Accuracy, Observation, State
from protocol.scene import Goal, Horizons, PublicRobot, Scene

LOOK_S = 0.1
"""How often a wait for the compiling process looks whether it is still wanted."""
HORIZONS = Horizons(prediction_steps=4, estimation_steps=2)
"""Kernels are compiled for all sizes; small ones are quick."""
MEETING = {"1": (-1.5, 0.0, 0.0, 0.5), "2": (1.5, 0.1, 3.0, 0.5)}
"""States of two robots that are in each other's way."""
GOALS = {"1": Goal(x_m=1.5, y_m=0.0, heading_rad=0.0), "2": Goal(x_m=-1.5, y_m=0.0, heading_rad=3.0)}
PARKING = State.of(0.5, 0.0, 0.0, 0.5)
"""So near to its goal a robot may decide in another way."""
NOISY = Accuracy(position_m=0.01)
"""States that were seen with noise are filtered."""
TURN = np.array([[0.1, 0.2]])
"""What they drive, rad/s and m/s²: something from which goals can be inferred."""


def compile_in_background(unwanted: Callable[[], bool]) -> bool:
    """Wait until all kernels are on disk; where they are not, a process of its own compiles them.

    Compiling needs much memory, and a thread that compiles cannot be stopped.

    Returns:
        Whether they are there; False once they are unwanted, which is asked again and again.

    Raises:
        Refusal: they cannot be compiled or kept.
    """
    if is_complete():
        return True
    command = [sys.executable, "-P", "-m", "agent.process.warm"]
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # Ctrl-C is for whoever waits
    ) as process:
        try:
            while not unwanted():
                try:
                    _, complaint = process.communicate(timeout=LOOK_S)
                except subprocess.TimeoutExpired:
                    continue
                if process.returncode:
                    how = f"compiling the solver ended with exit status {process.returncode}"
                    raise Refusal(complaint.strip() or how, ExitStatus.FAILED)
                return True
            return False
        finally:
            process.kill()


@hidden("scipy.linalg")  # numba loads it for functions that no kernel calls
def warm_up(goals: GoalsName, solver: SolverName) -> float:
    """Use once all that a robot with this estimator and this solver uses, so that nothing is left to load.

    Returns:
        How long it took, in s.
    """
    begin_s = time.perf_counter()
    scene = Scene(robots=dict.fromkeys(MEETING, PublicRobot()), horizons=HORIZONS, goals=GOALS)
    options = DecisionOptions(goals=goals, solver=solver)
    agent = options.agent("1", GOALS["1"], scene, time.perf_counter)
    inputs = TURN.repeat(HORIZONS.estimation_steps + 2, axis=0)
    ways = [rollout(np.array(state), inputs, scene.step_s).tolist() for state in MEETING.values()]
    seen = [
        {robot: State.of(*at) for robot, at in zip(MEETING, now, strict=True)}
        for now in zip(*ways, strict=True)
    ]
    seen += REACQUIRED_AFTER * [{**seen[-1], "1": PARKING}]
    for step, states in enumerate(seen):
        accuracy = Accuracy() if step else NOISY
        agent.decide(
            Observation(epoch=0, step=step, time_s=step * scene.step_s, robots=states, accuracy=accuracy)
        )
    return time.perf_counter() - begin_s


def main() -> None:
    """Compile all kernels, unless they are on disk; of several processes that want it, one does it.

    Exit status: 0 they are on disk, 1 they cannot be compiled or kept.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if not is_complete():
        if not is_writable(FOLDER):
            found = " and ".join(str(place) for place in places())
            raise SystemExit(
                f"the solver is not compiled yet, and {found} cannot be written; set NUMBA_CACHE_DIR to a "
                "folder that can be, or to one that 'python -m agent.process.warm' has filled on such a "
                "processor"
            )
        FOLDER.mkdir(parents=True, exist_ok=True)
        with (FOLDER / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not is_complete():
                print(f"compiling the solver into {FOLDER}, which takes about a minute", flush=True)
                # This estimator begins as a simpler one; no other choice uses more.
                print(f"compiled in {warm_up('ioc', 'realtime'):.0f} s")
                mark_complete()
    print(f"the solver is compiled in {FOLDER}")


if __name__ == "__main__":
    main()
