"""What one robot remembers: the last observed states of every robot it has seen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from agent.vehicle import Array, recovered_inputs, rollout
from protocol.arrival import nearest_turn
from protocol.vehicle import STANDSTILL, Input

LONGEST_GAP = 10
"""Steps for which an unseen robot is taken to go on as it was; after that it counts as gone."""


@dataclass
class _Track:
    """One robot's states at consecutive steps up to the newest; the last ``unseen`` of them are guesses."""

    states: Array
    unseen: int = 0


class Memory:
    """A fixed window of states per robot, one state a step, headings without jumps by whole turns.

    A robot not seen at a step is taken to go on as it was; once it is seen again, the gap is filled by
    interpolation instead.
    """

    def __init__(self, window: int, step_s: float) -> None:
        """Remember at least ``window`` states a robot, taken every ``step_s`` seconds."""
        self._window = max(window, LONGEST_GAP + 2)
        self._step_s = step_s
        self._tracks: dict[str, _Track] = {}
        self.step = -1
        """The newest step seen; −1 before the first observation."""

    def remember(self, step: int, seen: Mapping[str, Sequence[float]]) -> bool:
        """Take in what was seen at a step: robot to (p_x, p_y, ψ, v).

        Returns:
            False for a step not newer than the last one: repeated, old and out-of-order observations change
            nothing.
        """
        if step <= self.step:
            return False
        passed = step - self.step
        self.step = step
        for robot, track in self._tracks.items():
            self._go_on(track, passed if robot not in seen else passed - 1)
        for robot in [robot for robot, track in self._tracks.items() if track.unseen > LONGEST_GAP]:
            del self._tracks[robot]
        for robot, state in seen.items():
            if robot in self._tracks:
                self._see_again(self._tracks[robot], np.array(state, dtype=float))
            else:
                self._tracks[robot] = _Track(np.array([state], dtype=float))
        return True

    @property
    def robots(self) -> list[str]:
        """All robots present, in an order that does not depend on who was seen first."""
        return sorted(self._tracks)

    def state(self, robot: str) -> Array:
        """The present state, shape (4,)."""
        state: Array = self._tracks[robot].states[-1]
        return state

    def present(self) -> dict[str, Array]:
        """The newest state of every robot, shape (4,)."""
        return {robot: self.state(robot) for robot in self._tracks}

    def states(self, robot: str, count: int) -> Array:
        """The last ``count`` states, or as many as are known, oldest first, shape (n, 4)."""
        return self._tracks[robot].states[-count:]

    def previous_input(self, robot: str) -> Input:
        """The input that led to the present state; zero when only one state is known."""
        states = self.states(robot, 2)
        return Input(*recovered_inputs(states, self._step_s)[-1].tolist()) if len(states) == 2 else STANDSTILL

    def _go_on(self, track: _Track, steps: int) -> None:
        if steps <= 0:
            return
        steps = min(steps, LONGEST_GAP + 1)
        ahead = rollout(track.states[-1], np.zeros((steps, 2)), self._step_s)[1:]
        track.states = np.concatenate([track.states, ahead])[-self._window :]
        track.unseen += steps

    def _see_again(self, track: _Track, state: Array) -> None:
        known = track.states[: len(track.states) - track.unseen]
        last = known[-1]
        state[2] = nearest_turn(state[2], last[2])
        shares = np.arange(1, track.unseen + 1)[:, None] / (track.unseen + 1)
        between = last + shares * (state - last)
        track.states = np.concatenate([known, between, state[None]])[-self._window :]
        track.unseen = 0
