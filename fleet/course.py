"""What a picture needs of a run, gathered from its messages: ways driven and goals estimated."""

from array import array
from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from protocol.messages import Message, Mind, PublicScene, Truth

PUBLISHED_TIMES_S = (1.6, 3.0)
"""The publication's figure shows a run at these times and at its end."""
LATE_STEPS = 5
"""Minds of one step arrive within this many further steps."""

Points = list[tuple[float, float]]


def shown_times_s(end_s: float) -> tuple[float, ...]:
    """The times at which a run is shown: those of the publication and the end; thirds of a short run."""
    if end_s >= 1.5 * PUBLISHED_TIMES_S[-1]:
        return (*PUBLISHED_TIMES_S, end_s)
    return (end_s / 3.0, 2.0 * end_s / 3.0, end_s) if end_s > 0.0 else (end_s,)


class Course:
    """Gathers a run from its messages, as they come or from a recording.

    Of the ways everything is kept, 32 bytes a robot and step; of the estimates only those that may be shown.
    Where the world was started again in between, its last epoch is shown.

    Args:
        step_s: Δt in s.
    """

    def __init__(self, step_s: float) -> None:
        self._step_s = step_s
        self._epoch: int | None = None
        self._begin()

    def _begin(self) -> None:
        self._poses: defaultdict[str, array[float]] = defaultdict(lambda: array("d"))
        self._early_estimates: dict[int, defaultdict[str, Points]] = {}
        self._late_estimates: dict[int, defaultdict[str, Points]] = {}
        self.end_s = 0.0
        """Time of the newest truth, in s."""

    def add(self, message: Message) -> None:
        """Take a truth or a mind; other messages show nothing more."""
        if isinstance(message, PublicScene | Truth) and message.epoch != self._epoch:
            self._epoch = message.epoch
            self._begin()
        if isinstance(message, Truth):
            self.end_s = message.time_s
            for name, robot in message.robots.items():
                state = robot.state
                self._poses[name].extend((message.time_s, state.x_m, state.y_m, state.heading_rad))
        elif isinstance(message, Mind) and message.estimates:
            estimates = self._estimates_of(message.step)
            for name, goal in message.estimates.items():
                estimates[name].append((goal.x_m, goal.y_m))

    def poses(self) -> dict[str, NDArray[np.float64]]:
        """By robot: time in s, x and y in m, heading in rad at every step of its, shape (steps, 4)."""
        return {name: np.array(poses).reshape(-1, 4) for name, poses in self._poses.items()}

    def estimates(self, time_s: float) -> Mapping[str, Sequence[tuple[float, float]]]:
        """Goals as they were estimated at one of the shown times or, without any then, last before it.

        Returns:
            By robot: the estimate of every observer, x and y in m.
        """
        kept = self._early_estimates | self._late_estimates
        step = max((step for step in kept if step * self._step_s <= time_s + 1e-9), default=None)
        return {} if step is None else kept[step]

    def _estimates_of(self, step: int) -> defaultdict[str, Points]:
        """Where the estimates of a step are gathered; the late ones before the newest are forgotten."""
        if step * self._step_s <= PUBLISHED_TIMES_S[-1] + 1e-9:
            return self._early_estimates.setdefault(step, defaultdict(list))
        newest = max(step, *self._late_estimates) if self._late_estimates else step
        for old in [old for old in self._late_estimates if old < newest - LATE_STEPS]:
            del self._late_estimates[old]
        return self._late_estimates.setdefault(step, defaultdict(list))
