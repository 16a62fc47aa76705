"""How long this device takes to decide, against the time that it has."""

import math
import statistics
import time

import numpy as np

from agent.check import Finding
from agent.process.options import RobotOptions
from agent.process.robot import make_agent
from agent.process.warm import warm_up
from agent.solve.vehicle import Array, rollout
from protocol.codec import decode, encode
from protocol.messages import Observation, State
from protocol.scene import Goal, PublicRobot, Scene

DECISIONS = 60
FEWEST = 10
"""So many are measured even on a very slow device."""
LONGEST_S = 20.0
"""After this time no further decision is measured."""
HELD_UP = 0.2
"""From this part of the time on, others that run here are worth a word."""
TIGHT = 0.6
"""From this part of Δt on little is left for the way to the world and back, and for whatever else runs."""
SMALLEST_RADIUS_M = 4.0
ELBOW_ROOM = 1.5
"""Between neighbours on the circle, as a multiple of the distance at which robots are safe."""
PAST_THE_CENTRE_RAD = 0.35
"""By so much everybody heads past the centre, all on the same side."""
SPEED_MPS = 1.5


def check_speed(options: RobotOptions, scene: Scene | None) -> Finding:
    """Decide in a crossing in memory; without the scene of a world, in one as the defaults have it."""
    crossed = scene or default_scene(options.robot, options.robots)
    durations_s, held_up = measure(options, crossed)
    count = len(crossed.robots)
    robots = f"{count} robot{'' if count == 1 else 's'} {'as in the world' if scene else 'expected'}"
    return judged(durations_s, held_up, crossed.step_s, robots, options.budget_s)


def default_scene(robot: str, count: int) -> Scene:
    """A scene as the defaults have it, for a robot among so many."""
    names = list(dict.fromkeys([robot, *map(str, range(1, count + 1))]))
    return Scene(robots=dict.fromkeys(names[:count], PublicRobot()))


def crossing(scene: Scene, steps: int) -> tuple[dict[str, Goal], dict[str, Array]]:
    """The goals of robots on a circle, each across from its robot, and states (steps + 1, 4) on the way.

    They drive straight on at a constant speed, whatever the others do.
    """
    count = len(scene.robots)
    widest_m = max(scene.safety_distance_m(robot, robot) for robot in scene.robots)
    radius_m = max(SMALLEST_RADIUS_M, ELBOW_ROOM * widest_m * count / math.tau)
    angles = np.arange(count) * math.tau / count
    places = radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    headings = angles + math.pi + PAST_THE_CENTRE_RAD
    speeds = [min(SPEED_MPS, robot.limits.speed_mps) for robot in scene.robots.values()]
    begin = np.column_stack([places, headings, speeds])
    ways = rollout(begin, np.zeros((count, steps, 2)), scene.step_s)
    across = np.column_stack([-places, angles + math.pi]).tolist()
    goals = (Goal(x_m=x_m, y_m=y_m, heading_rad=heading_rad) for x_m, y_m, heading_rad in across)
    return dict(zip(scene.robots, goals, strict=True)), dict(zip(scene.robots, ways, strict=True))


def measure(options: RobotOptions, scene: Scene) -> tuple[list[float], float]:
    """Decide again and again, each time from a pose as it comes in to the command as it goes out.

    Returns:
        How long each decision took, in s, and the part of that time in which this process had no processor.
    """
    warm_up(options.goals, options.solver)
    goals, ways = crossing(scene, DECISIONS)
    known = scene.model_copy(update={"goals": goals})
    agent = make_agent(options.model_copy(update={"goal": goals[options.robot]}), known)
    own, durations_s = ways[options.robot][0], []
    until_s, computed_s = time.perf_counter() + LONGEST_S, time.process_time()
    for step in range(DECISIONS):
        states = {robot: State.of(*way[step].tolist()) for robot, way in ways.items()}
        states[options.robot] = State.of(*own.tolist())
        seen = Observation(epoch=0, step=step, time_s=scene.time_s(step), robots=states)
        payload = encode(seen)
        begin_s = time.perf_counter()
        decision = agent.decide(decode(Observation, payload))
        if decision is not None:
            encode(decision.mind), encode(decision.command)
            own = rollout(own, np.array([decision.command.input]), scene.step_s)[-1]
        end_s = time.perf_counter()
        durations_s.append(end_s - begin_s)
        if end_s > until_s and len(durations_s) >= FEWEST:
            break
    computed_s = time.process_time() - computed_s
    return durations_s, max(0.0, 1.0 - computed_s / sum(durations_s))


def judged(
    durations_s: list[float], held_up: float, step_s: float, robots: str, budget_s: float | None
) -> Finding:
    """What to say of what was measured, against Δt and the budget that was to be kept, if any."""
    usual_s = statistics.quantiles(durations_s, n=20, method="inclusive")[-1]
    longest_s = max(durations_s)
    budget = "no budget" if budget_s is None else f"a budget of {_ms(budget_s)}"
    told = (
        f"{robots}, {budget}: median {_ms(statistics.median(durations_s))}, 95 % within {_ms(usual_s)}, "
        f"longest of {len(durations_s)} {_ms(longest_s)}; {100.0 * usual_s / step_s:.0f} % of "
        f"Δt = {_ms(step_s)}"
    )
    if held_up > HELD_UP:
        told += f"; others that run here took {100.0 * held_up:.0f} % of the time"
    remedy = "end what else runs here, expect fewer robots, or take a faster device"
    if budget_s is None:
        remedy = f"set --budget-ms to about half of Δt ({500.0 * step_s:.0f}), {remedy}"
    item = "decision time"
    if usual_s > step_s:
        late = "in real time, commands would come too late (a world in lock-step waits)"
        return Finding(item, "failed", f"{told}: {late}", remedy)
    if usual_s > TIGHT * step_s or longest_s > step_s:
        return Finding(item, "warning", f"{told}: little is left", remedy)
    return Finding(item, "ok", told)


def _ms(duration_s: float) -> str:
    return f"{1000.0 * duration_s:.3g} ms"
