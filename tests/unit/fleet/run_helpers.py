"""Runs made up from protocol messages, without a world and without robots."""

import math
import resource
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from fleet.record.experiment import RunFacts
from protocol.keys import Keys
from protocol.messages import Command, Message, Mind, State, Timings, TrueRobot, Truth
from protocol.scenario import Pose, Scenario, ScenarioRobot

EPOCH = 7
KEYS = Keys("test")
FACTS = RunFacts(
    scenario="8a", goals="ioc", solver="reference", clock="lockstep", seed=3, run="test", version="0.1.0"
)


def ring(robots: int) -> Scenario:
    """Robots on a ring, each with its goal opposite."""
    ring_m = max(4.0, 0.3 * robots)
    turns = [math.tau * i / robots for i in range(robots)]
    return Scenario(
        name=f"ring of {robots}",
        robots=[
            ScenarioRobot(
                id=str(i + 1),
                start=Pose(x_m=ring_m * math.cos(a), y_m=ring_m * math.sin(a)),
                goal=Pose(x_m=-ring_m * math.cos(a), y_m=-ring_m * math.sin(a)),
            )
            for i, a in enumerate(turns)
        ],
    )


def true_robot(**changes: object) -> TrueRobot:
    plain = {
        "state": State(x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0),
        "turn_rate_radps": 0.0,
        "acceleration_mps2": 0.0,
        "arrived_s": None,
        "driven_m": 0.0,
        "deadline_misses": 0,
        "clipped_commands": 0,
    }
    return TrueRobot(**(plain | changes))


def truth(step: int, robots: Mapping[str, Mapping[str, object]], **changes: object) -> Truth:
    """A truth at steps of 0.1 s in which each robot differs from a standing one as given."""
    plain = {"epoch": EPOCH, "minimum_distance_m": 1.5, "collisions": (), "verdict": None, "refused": {}}
    states = {name: true_robot(**robot) for name, robot in robots.items()}
    return Truth(step=step, time_s=0.1 * step, robots=states, **(plain | changes))


def mind(
    robot: str,
    step: int,
    estimates: Mapping[str, tuple[float, float]] | None = None,
    timings_ms: Mapping[str, float] | None = None,
    plan: Sequence[tuple[float, float]] = (),
    **changes: object,
) -> Mind:
    plain = {"epoch": EPOCH, "arrived": False, "failed": (), "solver_failures": 0, "cut_short_at": None}
    plain |= {"prediction": {}}
    return Mind(
        robot=robot,
        step=step,
        decision=step,
        estimates={
            name: State(x_m=x, y_m=y, heading_rad=0.0, speed_mps=0.0)
            for name, (x, y) in (estimates or {}).items()
        },
        plan=tuple(plan),
        timings_ms=Timings(**(timings_ms or {})),
        **(plain | changes),
    )


def command(robot: str, step: int, epoch: int = EPOCH) -> Command:
    return Command(epoch=epoch, robot=robot, step=step, turn_rate_radps=0.0, acceleration_mps2=0.0)


def straight_run(scenario: Scenario, duration_s: float) -> Iterator[Message]:
    """Everybody drives straight to its goal at one speed; everybody estimates every goal halfway."""
    steps = round(duration_s / scenario.step_s)
    for step in range(steps + 1):
        part = step / steps if steps else 0.0
        robots, halfway = {}, {}
        for r in scenario.robots:
            x0, y0, heading_rad, _ = r.start_state()
            x_m, y_m = x0 + part * (r.goal.x_m - x0), y0 + part * (r.goal.y_m - y0)
            state = State(x_m=x_m, y_m=y_m, heading_rad=heading_rad, speed_mps=1.0)
            robots[r.id] = {"state": state, "arrived_s": duration_s if step == steps else None}
            halfway[r.id] = ((x0 + r.goal.x_m) / 2.0, (y0 + r.goal.y_m) / 2.0)
        yield truth(step, robots, verdict="arrived" if step == steps else None)
        for r in scenario.robots:
            yield mind(r.id, step, halfway, {"estimate": 1.0, "plan": 2.0, "decide": 4.0})


@contextmanager
def file_size_limit(limit_bytes: int) -> Iterator[None]:
    """The kernel refuses every byte of a file beyond this with a real OSError, as a full disk does."""
    former = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, former[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, former)
