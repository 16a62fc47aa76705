"""What was seen of one robot, and the states that follow from it, one a step."""

import numpy as np

from agent.filtering import (
    EXACT,
    Belief,
    change_sigmas,
    first_belief,
    smooth,
    standing_belief,
    unknown_sigmas,
)
from agent.vehicle import Array, recovered_inputs, rollout
from protocol.arrival import nearest_turn
from protocol.vehicle import STANDSTILL, Input, Limits

INPUT_ACCURACY = 0.01
"""σ of an input that is known because it was commanded, relative to its limit."""


class Track:
    """Measurements of one robot, and its states at consecutive steps up to the present.

    Exact measurements are states, and gaps between them are filled by interpolation. Noisy ones are filtered
    and smoothed, each step anew over the whole window. Since the last measurement the robot is taken to have
    gone on with its last input.

    Attributes:
        seen_step: step of the last measurement.
        states: up to the present, headings without jumps by whole turns, shape (n, 4).
    """

    def __init__(self, step: int, state: Array, sigmas: Array, limits: Limits, step_s: float) -> None:
        """Begin with a first measurement.

        Args:
            step: at which it was made; all robots stand at step 0.
            state: measured, shape (4,).
            sigmas: its standard deviations, zero for exact, shape (4,).
            limits: of the robot.
            step_s: Δt.
        """
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
        """Take in a later measurement; ``go_on`` brings the states up to date.

        Args:
            step: at which it was made.
            state: measured, shape (4,).
            sigmas: its standard deviations, shape (4,).
            driven: the input that led there, where it is known.
        """
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
        states = self._as_seen(ahead, old) if self.is_exact else self._smoothed(ahead, old)
        self.states = states[-window:]
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
