"""The referee: arrivals, collisions, distances, deadlock and the verdict."""

import math
from collections import deque
from collections.abc import Mapping
from itertools import combinations

from protocol.messages import Verdict
from protocol.scenario import Scenario
from protocol.scene import Scene
from protocol.vehicle import has_arrived
from world.vehicle import VehicleState

DEADLOCK_WINDOW_S = 5.0
DEADLOCK_DISTANCE_M = 0.05


class Distances:
    """Measures ways and distances, step by step.

    Attributes:
        driven_m: way driven by each robot, Σ |Δp|.
        minimum_distance_m: smallest distance of two centres so far, None with a single robot.
        collisions: pairs that have come closer than their bodies allow, each once, in this order.
    """

    def __init__(self, scene: Scene) -> None:
        self._collision_distance_m = {
            pair: scene.collision_distance_m(*pair) for pair in combinations(scene.robots, 2)
        }
        self._before: Mapping[str, VehicleState] | None = None
        self.driven_m = dict.fromkeys(scene.robots, 0.0)
        self.minimum_distance_m: float | None = None
        self.collisions: tuple[tuple[str, str], ...] = ()

    def measure(self, states: Mapping[str, VehicleState]) -> None:
        """Take in one step."""
        self._measure_way(states)
        self._measure_distances(states)

    def _measure_way(self, states: Mapping[str, VehicleState]) -> None:
        if self._before is not None:
            for robot in states.keys() & self._before.keys():
                now, before = states[robot], self._before[robot]
                self.driven_m[robot] += math.hypot(now.x_m - before.x_m, now.y_m - before.y_m)
        self._before = states

    def _measure_distances(self, states: Mapping[str, VehicleState]) -> None:
        for one, other in combinations(states, 2):
            a, b, least_m = states[one], states[other], self._collision_distance_m[one, other]
            distance_m = math.hypot(a.x_m - b.x_m, a.y_m - b.y_m)
            if self.minimum_distance_m is None or distance_m < self.minimum_distance_m:
                self.minimum_distance_m = distance_m
            if distance_m < least_m and (one, other) not in self.collisions:
                self.collisions += ((one, other),)


class Referee:
    """Judges a run by the true states at the steps; what lies between two steps is not looked at.

    - Robots that are not in the scene are not judged, and those that have left it for good not awaited.
    - A robot has arrived at the first step at which the arrival rule holds; it stays arrived.
    - Two robots have collided when their centres come closer than their radii allow. The run goes on.
    - Deadlock: before all have arrived, every robot has driven less than 0.05 m within the last 5 s. The
      driven way counts, not the displacement, so a robot manoeuvring on the spot is not taken for a
      standing one.
    - The run ends when all have arrived, on deadlock, or at the first step at or after the time limit. Of
      several verdicts the worst is given: collision, then deadlock, then timeout; a run whose last robot
      arrives at the very time limit has arrived.

    Attributes:
        arrived_s: time of arrival of each robot, None before it.
        distances: the ways and distances so far.
        verdict: None while the run goes on.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._time_s = scenario.time_s
        self._robots = scenario.robots
        self._tolerance = scenario.arrival_tolerance
        self._goals = {robot.id: robot.goal_pose().as_state() for robot in scenario.robots}
        self._last_step = _steps_in(scenario.time_limit_s, scenario.step_s)
        self._driven_before: deque[dict[str, float]] = deque(
            maxlen=_steps_in(DEADLOCK_WINDOW_S, scenario.step_s) + 1
        )
        self.arrived_s: dict[str, float | None] = dict.fromkeys(self._goals)
        self.distances = Distances(scenario.scene(with_goals=False))
        self.verdict: Verdict | None = None

    def watch(self, step: int, states: Mapping[str, VehicleState]) -> None:
        """Judge one step; to be called for every step from 0 on."""
        self.distances.measure(states)
        self._driven_before.append(dict(self.distances.driven_m))
        for robot, state in states.items():
            if self.arrived_s[robot] is None and has_arrived(state, self._goals[robot], self._tolerance):
                self.arrived_s[robot] = self._time_s(step)
        self.verdict = self._judge(step)

    def _judge(self, step: int) -> Verdict | None:
        verdict: Verdict | None = None
        if all(self.arrived_s[robot] is not None for robot in self._awaited(step)):
            verdict = "arrived"
        elif self._nobody_moves():
            verdict = "deadlock"
        elif step >= self._last_step:
            verdict = "timeout"
        return "collision" if verdict and self.distances.collisions else verdict

    def _awaited(self, step: int) -> set[str]:
        """Robots that are to arrive: all but those that have left for good."""
        last_s = self._time_s(self._last_step)
        return {
            robot.id
            for robot in self._robots
            if not any(
                begin_s <= self._time_s(step) and end_s > last_s for begin_s, end_s in robot.absences_s
            )
        }

    def _nobody_moves(self) -> bool:
        if len(self._driven_before) < (self._driven_before.maxlen or 0):
            return False
        then = self._driven_before[0]
        return all(
            driven - then[robot] < DEADLOCK_DISTANCE_M for robot, driven in self.distances.driven_m.items()
        )


def _steps_in(duration_s: float, step_s: float) -> int:
    """The first step at or after a duration; a quotient that is whole up to rounding is taken as whole."""
    return math.ceil(duration_s / step_s - 1e-9)
