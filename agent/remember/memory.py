"""What one robot remembers: the last states of every robot it has seen."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from agent.remember.filtering import (
    EXACT,
    Belief,
    change_sigmas,
    first_belief,
    smooth,
    standing_belief,
    unknown_sigmas,
)
from agent.solve.vehicle import Array, recovered_inputs, rollout
from protocol.vehicle import STANDSTILL, Input, Limits, nearest_turn

INPUT_ACCURACY = 0.01
"""σ of an input that is known because it was commanded, relative to its limit."""
LONGEST_GAP = 10
"""Steps for which an unseen robot is taken to go on as it was; after that it counts as gone."""
MOST_CAUTIOUS_STEPS = 6
"""A robot that nobody sees may be anywhere; after so many steps more distance would only block the way."""


class Track:
    """Measurements of one robot, and its states at consecutive steps up to the present.

    Exact measurements are states, and gaps between them are filled by interpolation. Noisy ones are filtered
    and smoothed, each step anew over the whole window. Since the last measurement the robot is taken to have
    gone on with its last input. It begins with a measured state (4,) and its σ (4,), zero for exact; all
    robots stand at step 0.

    Attributes:
        seen_step: step of the last measurement.
        states: up to the present, headings without jumps by whole turns, shape (n, 4).
    """

    def __init__(self, step: int, state: Array, sigmas: Array, limits: Limits, step_s: float) -> None:
        self.seen_step = step
        self.states = state[None]
        self._limits = limits
        self._step_s = step_s
        self._input_limits = np.array([limits.turn_rate_radps, limits.acceleration_mps2])
        self._values = np.append(state, [0.0, 0.0])[None]
        self._sigmas = np.append(sigmas, [np.inf, np.inf])[None]
        self._changes = change_sigmas(limits, step_s)
        self._prior: Belief | None = standing_belief(state) if step == 0 else None

    @property
    def is_exact(self) -> bool:
        """Whether the last measurement was."""
        return not self._sigmas[-1, :4].any()

    @property
    def sigma_m(self) -> float:
        """σ of the position in the last measurement."""
        return float(self._sigmas[-1, :2].max())

    @property
    def saw_step_before(self) -> bool:
        """Whether there was a measurement at the step before that of the last one, too."""
        return len(self._sigmas) > 1 and bool(np.isfinite(self._sigmas[-2, 0]))

    @property
    def previous_input(self) -> Input:
        """The input that led to the present state; zero when only one state is known."""
        if len(self.states) == 1:
            return STANDSTILL
        found = recovered_inputs(self.states[-2:], self._step_s)[0]
        if not self.is_exact:
            found = np.clip(found, -self._input_limits, self._input_limits)
        return Input(*found.tolist())

    def see(self, step: int, state: Array, sigmas: Array, driven: Input | None) -> None:
        """Take in a later measurement, and the input that led there if it is known; then :meth:`go_on`."""
        gap, last = step - self.seen_step - 1, self._values[-1]
        values, accuracy = np.append(state, [0.0, 0.0]), np.append(sigmas, [np.inf, np.inf])
        values[2] = nearest_turn(values[2], last[2])
        if driven is not None:
            values[4:], accuracy[4:] = driven, INPUT_ACCURACY * self._input_limits
        between = last + np.arange(1, gap + 1)[:, None] / (gap + 1) * (values - last)
        self._values = np.concatenate([self._values, between, values[None]])
        self._sigmas = np.concatenate([self._sigmas, np.full((gap, 6), np.inf), accuracy[None]])
        self.seen_step = step

    def go_on(self, step: int, window: int) -> None:
        """Bring the states up to a present step; those before the last ``window`` are forgotten."""
        ahead = step - self.seen_step
        old = min(max(len(self._values) + ahead - window, 0), len(self._values) - 1)
        self.states = (self._as_seen(ahead, old) if self.is_exact else self._smoothed(ahead, old))[-window:]
        self._values, self._sigmas = self._values[old:], self._sigmas[old:]

    def _as_seen(self, ahead: int, old: int) -> Array:
        if old:
            self._prior = None
        known = self._values[:, :4]
        if not ahead:
            return known
        last = recovered_inputs(known[-2:], self._step_s)[0] if len(known) > 1 else np.zeros(2)
        guessed = rollout(known[-1], np.tile(last, (ahead, 1)), self._step_s)[1:]
        return np.concatenate([known, self._possible(guessed)])

    def _smoothed(self, ahead: int, old: int) -> Array:
        prior = self._prior or first_belief(self._values[0, :4], unknown_sigmas(self._limits))
        values = np.concatenate([self._values, np.zeros((ahead, 6))])
        sigmas = np.concatenate([np.maximum(self._sigmas, EXACT), np.full((ahead, 6), np.inf)])
        found, means, covariances = smooth(*prior, values, sigmas, self._changes, self._step_s)
        self._prior = Belief(means[old].copy(), covariances[old].copy())
        return self._possible(found[:, :4])

    def _possible(self, states: Array) -> Array:
        """The states, none faster than the robot can be."""
        states[:, 3] = np.clip(states[:, 3], -self._limits.speed_mps, self._limits.speed_mps)
        return states


class Memory:
    """A fixed window of states per robot, one state a step, headings without jumps by whole turns.

    Measurements belong to the step at which they were made, and noisy ones are smoothed (:class:`Track`).

    Args:
        window: states a robot, at least.
        step_s: Δt.
        owner: the robot that remembers, whose own measurements are never old.
        limits_of: limits of each robot.

    Attributes:
        step: the newest step seen; −1 before the first observation.
    """

    def __init__(
        self,
        window: int,
        step_s: float,
        *,
        owner: str | None = None,
        limits_of: Callable[[str], Limits] = lambda _: Limits(),
    ) -> None:
        self._window = max(window, LONGEST_GAP + 2)
        self._step_s = step_s
        self._owner = owner
        self._limits_of = limits_of
        self._tracks: dict[str, Track] = {}
        self.step = -1

    def remember(
        self,
        step: int,
        seen: Mapping[str, Sequence[float]],
        *,
        sigmas: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
        age_steps: int = 0,
        driven: Input | None = None,
    ) -> bool:
        """Take in what was seen at a step.

        Args:
            step: the present one.
            seen: robot to (p_x, p_y, ψ, v).
            sigmas: standard deviations of these; zero for exact.
            age_steps: how many steps ago the others were in these states.
            driven: the owner's input at the step before, if it is known.

        Returns:
            False for a step not newer than the last one, which changes nothing.
        """
        if step <= self.step:
            return False
        self.step = step
        accuracy = np.array(sigmas, dtype=float)
        for robot, values in seen.items():
            own, state = robot == self._owner, np.array(values, dtype=float)
            seen_step, track = step if own else step - age_steps, self._tracks.get(robot)
            if track is None or seen_step - track.seen_step - 1 > LONGEST_GAP:
                limits = self._limits_of(robot)
                self._tracks[robot] = Track(seen_step, state, accuracy, limits, self._step_s)
            elif seen_step > track.seen_step:
                track.see(seen_step, state, accuracy, driven if own else None)
        for robot, track in list(self._tracks.items()):
            age = 0 if robot == self._owner else age_steps
            if step - age - track.seen_step > LONGEST_GAP:
                del self._tracks[robot]
            else:
                track.go_on(step, self._window)
        return True

    def forget(self, robot: str) -> None:
        """What was seen of a robot so far does not count any more."""
        self._tracks.pop(robot, None)

    @property
    def robots(self) -> list[str]:
        """All robots present, in an order that does not depend on who was seen first."""
        return sorted(self._tracks)

    def state(self, robot: str) -> Array:
        """The present state, shape (4,)."""
        state: Array = self._tracks[robot].states[-1]
        return state

    def present(self) -> dict[str, Array]:
        """The present state of every robot, shape (4,)."""
        return {robot: self.state(robot) for robot in self._tracks}

    def states(self, robot: str, count: int) -> Array:
        """The last ``count`` states, or as many as are known, oldest first, shape (n, 4)."""
        return self._tracks[robot].states[-count:]

    def previous_input(self, robot: str) -> Input:
        """The input that led to the present state; zero when only one state is known."""
        return self._tracks[robot].previous_input

    def saw_last_step(self, robot: str) -> bool:
        """Whether a robot was seen at both ends of the last step, so that its previous input is no guess."""
        track = self._tracks[robot]
        return track.saw_step_before and track.seen_step == self.step

    def unseen_steps(self, robot: str) -> int:
        """How many steps ago a robot was in the state in which it was last seen."""
        return self.step - self._tracks[robot].seen_step

    def caution_m(self, robot: str) -> float:
        """How far a robot may be from where it is taken to be, had it accelerated since it was seen."""
        return self._accelerated_m(robot, min(self.unseen_steps(robot), MOST_CAUTIOUS_STEPS))

    def most_caution_m(self, robot: str) -> float:
        """The highest value of :meth:`caution_m`."""
        return self._accelerated_m(robot, MOST_CAUTIOUS_STEPS)

    def _accelerated_m(self, robot: str, steps: int) -> float:
        return self._limits_of(robot).acceleration_mps2 * (steps * self._step_s) ** 2 / 2.0

    def sigma_m(self, robot: str) -> float:
        """σ of the position at which a robot was last seen."""
        return self._tracks[robot].sigma_m

    def is_certain(self, robot: str) -> bool:
        """Whether a robot's present state was seen, and without noise: then all others may see the same."""
        return self.is_exact(robot) and not self.unseen_steps(robot)

    def is_exact(self, robot: str) -> bool:
        """Whether a robot was last seen without noise."""
        return self._tracks[robot].is_exact
