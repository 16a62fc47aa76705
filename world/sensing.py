"""What one robot's sensors see: range, noise, dropouts and delay, from a random stream of its own."""

import math
from collections import deque
from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from protocol.messages import Accuracy, State
from protocol.scenario import Sensing
from world.vehicle import VehicleState


class View(NamedTuple):
    """What an observer sees at a step."""

    robots: dict[str, State]
    """Robots in view with their measured states, headings wrapped to [−π, π]."""
    age_steps: int
    """How many steps ago the others were measured."""


class Sensors:
    """The sensors of one observer.

    Every step draws one uniform and four normal numbers for every robot of the run, whatever is in view.
    What an observer sees of one robot therefore never depends on where another robot is.

    A delayed view was measured some steps ago, with the range, the noise and the dropouts of then. Until
    there is one so old, the first view stands.

    Attributes:
        accuracy: standard deviations of the noise.

    Args:
        observer: id of the robot that carries the sensors.
        sensing: their quality.
        seed: of the run.
        index: the observer's place in the scenario; with the seed it fixes the random stream.
    """

    def __init__(self, observer: str, sensing: Sensing, *, seed: int, index: int) -> None:
        self._observer = observer
        self._range_m = math.inf if sensing.range_m is None else sensing.range_m
        self._dropout = sensing.dropout
        self._sigma = np.array(
            [
                sensing.position_noise_m,
                sensing.position_noise_m,
                sensing.heading_noise_rad,
                sensing.speed_noise_mps,
            ]
        )
        self._random = np.random.default_rng(np.random.SeedSequence((seed, index)))
        self._measured: deque[dict[str, State]] = deque(maxlen=sensing.delay_steps + 1)
        self.accuracy = Accuracy(
            position_m=sensing.position_noise_m,
            heading_rad=sensing.heading_noise_rad,
            speed_mps=sensing.speed_noise_mps,
        )

    def see(self, states: Mapping[str, VehicleState], present: Collection[str] | None = None) -> View:
        """Observe all robots at the next step; every call draws anew.

        The observer is always in its own view, with noise; range (of the true positions), dropouts and delay
        concern the others.

        Args:
            states: true states of all robots, the same robots in the same order at every call.
            present: those that are there to be seen; None: all.
        """
        measured = self._measure(states, states.keys() if present is None else present)
        self._measured.append(measured)
        return View({**self._measured[0], self._observer: measured[self._observer]}, len(self._measured) - 1)

    def _measure(self, states: Mapping[str, VehicleState], present: Collection[str]) -> dict[str, State]:
        own = states[self._observer]
        lots = self._random.random(len(states))
        errors = (self._random.standard_normal((len(states), 4)) * self._sigma).tolist()
        view = {}
        for (robot, state), lot, error in zip(states.items(), lots, errors, strict=True):
            distance_m = math.hypot(state.x_m - own.x_m, state.y_m - own.y_m)
            seen = robot in present and distance_m <= self._range_m and lot >= self._dropout
            if seen or robot == self._observer:
                view[robot] = State.of(*(true + off for true, off in zip(state, error, strict=True)))
        return view
