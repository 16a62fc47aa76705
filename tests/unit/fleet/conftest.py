"""Runs made up from protocol messages, without a world and without robots; and a clock for keys."""

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import pytest
from keys_helpers import Clock

from fleet.keys import command
from fleet.run.experiment import RunFacts
from protocol.messages import Message, Mind, State, Timings, TrueRobot, Truth
from protocol.scenario import Pose, Scenario, ScenarioRobot

EPOCH = 7


@pytest.fixture
def facts() -> RunFacts:
    return RunFacts(
        scenario="8a", goals="ioc", solver="reference", clock="lockstep", seed=3, run="test", version="0.1.0"
    )


@pytest.fixture
def make_scenario() -> Callable[..., Scenario]:
    return ring_scenario


@pytest.fixture
def make_truth() -> Callable[..., Truth]:
    return truth


@pytest.fixture
def make_mind() -> Callable[..., Mind]:
    return mind


@pytest.fixture
def make_run() -> Callable[[Scenario, float], Iterator[Message]]:
    return straight_run


def ring_scenario(robots: int, **rules: object) -> Scenario:
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
        **rules,
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
    plain = {"minimum_distance_m": 1.5, "collisions": (), "verdict": None, "refused": {}}
    states = {name: true_robot(**robot) for name, robot in robots.items()}
    return Truth(epoch=EPOCH, step=step, time_s=0.1 * step, robots=states, **(plain | changes))


def mind(
    robot: str,
    step: int,
    estimates: Mapping[str, tuple[float, float]] | None = None,
    timings_ms: Mapping[str, float] | None = None,
    plan: Sequence[tuple[float, float]] = (),
    solver_failures: int = 0,
) -> Mind:
    return Mind(
        epoch=EPOCH,
        robot=robot,
        step=step,
        decision=step,
        arrived=False,
        estimates={
            name: State(x_m=x, y_m=y, heading_rad=0.0, speed_mps=0.0)
            for name, (x, y) in (estimates or {}).items()
        },
        prediction={},
        plan=tuple(plan),
        failed=(),
        solver_failures=solver_failures,
        cut_short_at=None,
        timings_ms=Timings(**(timings_ms or {})),
    )


def straight_run(scenario: Scenario, duration_s: float) -> Iterator[Message]:
    """Everybody drives straight to its goal at one speed; everybody estimates every goal halfway."""
    steps = round(duration_s / scenario.step_s)
    for step in range(steps + 1):
        part = step / steps if steps else 0.0
        robots = {}
        for r in scenario.robots:
            x0, y0, heading_rad, _ = r.start_state()
            length_m = math.hypot(r.goal.x_m - x0, r.goal.y_m - y0)
            robots[r.id] = {
                "state": State(
                    x_m=x0 + part * (r.goal.x_m - x0),
                    y_m=y0 + part * (r.goal.y_m - y0),
                    heading_rad=heading_rad,
                    speed_mps=length_m / duration_s if duration_s else 0.0,
                ),
                "arrived_s": duration_s if step == steps else None,
                "driven_m": part * length_m,
            }
        yield truth(step, robots, verdict="arrived" if step == steps else None)
        halfway = {
            r.id: ((r.start.x_m + r.goal.x_m) / 2.0, (r.start.y_m + r.goal.y_m) / 2.0)
            for r in scenario.robots
        }
        for r in scenario.robots:
            yield mind(r.id, step, halfway, {"estimate": 1.0, "plan": 2.0, "decide": 4.0})


@pytest.fixture
def clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Clock:
    """A clock that stands still, in an empty directory."""
    monkeypatch.chdir(tmp_path)
    for name in ("COLUMNS", "TERMINAL_WIDTH"):
        monkeypatch.setenv(name, "200")
    clock = Clock()
    monkeypatch.setattr(command, "_now", lambda: clock.now)
    return clock


@pytest.fixture(params=[0o000, 0o022, 0o077], ids=oct)
def umask(request: pytest.FixtureRequest) -> Iterator[None]:
    former = os.umask(request.param)
    yield
    os.umask(former)
