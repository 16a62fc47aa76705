"""How long this device takes to decide, against the time that it has."""

import math
import statistics
import time
from typing import NamedTuple

import numpy as np

from agent.check.findings import Finding
from agent.process.options import RobotOptions
from agent.process.robot import make_agent
from agent.process.warm import warm_up
from agent.solve.vehicle import Array, rollout
from protocol.codec import decode, encode
from protocol.messages import Observation, State
from protocol.scene import Goal, PublicRobot, Scene
from protocol.vehicle import Input

ITEM = "decision time"
DECISIONS = 60
FEWEST = 10
"""So many are measured even on a very slow options."""
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
ACCELERATION_MPS2 = 0.5


def scene_of(robot: str, count: int) -> Scene:
    """A scene as the defaults have it, for a robot among so many."""
    others = (name for number in range(1, count + 1) if (name := str(number)) != robot)
    names = [robot, *others][:count]
    return Scene(robots=dict.fromkeys(names, PublicRobot()))


class Crossing:
    """All robots of a scene on a circle; one drives as it decides, the others as they would alone.

    Args:
        scene: limits, bodies and Δt.
        robot: the one that decides.
        steps: for which it lasts.
    """

    def __init__(self, scene: Scene, robot: str, steps: int) -> None:
        self._scene = scene
        self._robot = robot
        self._names = list(scene.robots)
        angles = np.arange(len(self._names)) * math.tau / len(self._names)
        radius_m = self._radius_m()
        places = radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        headings = angles + math.pi + PAST_THE_CENTRE_RAD
        still = np.column_stack([places, headings, np.zeros(len(angles))])
        self._ways = rollout(
            still, np.stack([self._inputs(name, steps) for name in self._names]), scene.step_s
        )
        self._own: Array = still[self._names.index(robot)]
        ends = places + 2.0 * radius_m * math.cos(PAST_THE_CENTRE_RAD) * np.stack(
            [np.cos(headings), np.sin(headings)], axis=-1
        )
        self.goals = {
            name: Goal(x_m=float(x_m), y_m=float(y_m), heading_rad=float(heading))
            for name, (x_m, y_m), heading in zip(self._names, ends, headings, strict=True)
        }

    def observation(self, step: int) -> Observation:
        """What the deciding robot sees: everybody, exactly."""
        states = dict(zip(self._names, self._ways[:, step], strict=True)) | {self._robot: self._own}
        return Observation(
            epoch=0,
            step=step,
            time_s=self._scene.time_s(step),
            robots={name: State.of(*state.tolist()) for name, state in states.items()},
        )

    def drive(self, control: Input) -> None:
        """The deciding robot drives this for a step."""
        self._own = rollout(self._own, np.array([control]), self._scene.step_s)[-1]

    def _radius_m(self) -> float:
        widest_m = max(self._scene.safety_distance_m(one, one) for one in self._names)
        return max(SMALLEST_RADIUS_M, ELBOW_ROOM * widest_m * len(self._names) / math.tau)

    def _inputs(self, name: str, steps: int) -> Array:
        """Straight ahead, from standstill up to a speed, within the robot's limits."""
        limits, step_s = self._scene.robot(name).limits, self._scene.step_s
        acceleration = min(ACCELERATION_MPS2, limits.acceleration_mps2, limits.jerk_mps3 * step_s)
        speed_mps = min(SPEED_MPS, limits.speed_mps)
        inputs = np.zeros((steps, 2))
        inputs[: int(speed_mps / (acceleration * step_s)), 1] = acceleration
        return inputs


class Taken(NamedTuple):
    """Time that decisions have taken."""

    durations_s: list[float]
    """Of each, on the clock."""
    computed_s: float
    """By this process on a processor, all together."""

    @property
    def held_up(self) -> float:
        """The part of the time in which this process had no processor."""
        return max(0.0, 1.0 - self.computed_s / sum(self.durations_s))


def check_speed(options: RobotOptions, scene: Scene | None) -> Finding:
    """Decide in a crossing in memory.

    Args:
        options: of the robot.
        scene: of the world that was reached; None for one as the defaults have it.
    """
    crossed = scene or scene_of(options.robot, options.robots)
    taken = measure(options, crossed)
    count = len(crossed.robots)
    robots = f"{count} robot{'' if count == 1 else 's'} {'as in the world' if scene else 'expected'}"
    return judged(taken, crossed.step_s, robots, options.budget_s)


def measure(options: RobotOptions, scene: Scene) -> Taken:
    """Decide again and again, each time from a pose as it comes in to the command as it goes out.

    Args:
        options: of the robot; its goal is one across the circle here.
        scene: limits, bodies, horizons and Δt.
    """
    warm_up(options.goals, options.solver)
    crossing = Crossing(scene, options.robot, DECISIONS)
    known = scene.model_copy(update={"goals": crossing.goals})
    agent = make_agent(options.model_copy(update={"goal": crossing.goals[options.robot]}), known)
    until_s = time.perf_counter() + LONGEST_S
    taken = Taken([], 0.0)
    begun_s = time.process_time()
    for step in range(DECISIONS):
        payload = encode(crossing.observation(step))
        begin_s = time.perf_counter()
        decision = agent.decide(decode(Observation, payload))
        if decision is not None:
            encode(decision.mind), encode(decision.command)
            crossing.drive(decision.command.input)
        end_s = time.perf_counter()
        taken.durations_s.append(end_s - begin_s)
        if end_s > until_s and len(taken.durations_s) >= FEWEST:
            break
    return taken._replace(computed_s=time.process_time() - begun_s)


def judged(taken: Taken, step_s: float, robots: str, budget_s: float | None) -> Finding:
    """What to say of it.

    Args:
        taken: by decisions.
        step_s: Δt, their deadline.
        robots: with how many, for people.
        budget_s: that was to be kept, if any.
    """
    durations_s = taken.durations_s
    usual_s = statistics.quantiles(durations_s, n=20, method="inclusive")[-1]
    longest_s = max(durations_s)
    budget = "no budget" if budget_s is None else f"a budget of {_ms(budget_s)}"
    told = (
        f"{robots}, {budget}: median {_ms(statistics.median(durations_s))}, 95 % within {_ms(usual_s)}, "
        f"longest of {len(durations_s)} {_ms(longest_s)}; {100.0 * usual_s / step_s:.0f} % of "
        f"Δt = {_ms(step_s)}"
    )
    if taken.held_up > HELD_UP:
        told += f"; others that run here took {100.0 * taken.held_up:.0f} % of the time"
    remedy = "end what else runs here, expect fewer robots, or take a faster device"
    if budget_s is None:
        remedy = f"set --budget-ms to about half of Δt ({500.0 * step_s:.0f}), {remedy}"
    if usual_s > step_s:
        late = "in real time, commands would come too late (a world in lock-step waits)"
        return Finding(ITEM, "failed", f"{told}: {late}", remedy)
    if usual_s > TIGHT * step_s or longest_s > step_s:
        return Finding(ITEM, "warning", f"{told}: little is left", remedy)
    return Finding(ITEM, "ok", told)


def _ms(duration_s: float) -> str:
    return f"{1000.0 * duration_s:.3g} ms"
