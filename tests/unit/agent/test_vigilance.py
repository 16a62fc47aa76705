"""When a robot stops for somebody whom it does not see, and what it then takes for granted."""

import math

import pytest
from agent_helpers import STEP_S, euler, scene_of

from agent.drive.safety import BLIND_STEPS, GONE_STEPS, Vigilance
from agent.remember.memory import LONGEST_GAP, Memory

Place = tuple[float, float, float, float]
OWN: Place = (0.0, 0.0, 0.0, 1.0)
NEAR: Place = (3.5, 0.0, math.pi, 1.0)
"""Ahead, and it comes."""
AWAY: Place = (2.2, 0.0, 0.0, 1.5)
"""Ahead, and faster than who looks."""
FAR: Place = (9.0, 0.0, math.pi, 1.0)
BESIDE: Place = (0.0, 1.5, 0.0, 1.0)
"""Within the safety distance and half a metre more, side by side."""
LAST_SEEN = 4


class Watch:
    """Robot a, which stays where it is, and what it makes of robot b."""

    def __init__(self) -> None:
        self.memory = Memory(17, STEP_S)
        self.vigilance = Vigilance(scene_of("ab"), "a")

    def sees(self, step: int, other: Place | None) -> bool:
        """Whether it is to stop."""
        self.memory.remember(step, {"a": OWN} if other is None else {"a": OWN, "b": other})
        return self.vigilance.look(self.memory)

    def loses(self, other: Place, steps: int) -> list[bool]:
        """After some steps, from each step without the other robot: whether it is to stop."""
        coming = euler(other, [(0.0, 0.0)] * LAST_SEEN, -STEP_S)[::-1].tolist()  # straight on, backwards
        assert not any(self.sees(step, tuple(where)) for step, where in enumerate(coming))
        return [self.sees(LAST_SEEN + gone, None) for gone in range(1, steps + 1)]


@pytest.mark.parametrize(
    ("other", "is_in_the_way"),
    [(NEAR, True), (BESIDE, True), (AWAY, False), (FAR, False)],
    ids=["near and approaching", "beside", "receding", "far"],
)
def test_it_stops_for_somebody_in_its_way_whom_it_has_not_seen_for_too_long(other, is_in_the_way):
    watch = Watch()
    stops = watch.loses(other, BLIND_STEPS + 2)
    assert stops == [False] * BLIND_STEPS + [is_in_the_way] * 2
    assert not watch.sees(LAST_SEEN + BLIND_STEPS + 3, (2.8, 0.0, math.pi, 1.0)), "it sees the other again"


def test_it_drives_on_when_the_other_has_been_gone_for_long():
    """The robot stops long after its memory has dropped the other one, but not for ever."""
    stops = Watch().loses(BESIDE, GONE_STEPS + 2)
    assert stops[LONGEST_GAP + 1]
    assert [step for step, stop in enumerate(stops, 1) if stop] == list(
        range(BLIND_STEPS + 1, GONE_STEPS + 1)
    )


def test_a_late_view_that_says_so_is_seen():
    memory, vigilance = Memory(17, STEP_S, owner="a"), Vigilance(scene_of("ab"), "a")
    late = BLIND_STEPS + 2
    for step in range(3 * late):
        memory.remember(step, {"a": OWN, "b": (*BESIDE[:3], 0.0)}, age_steps=min(step, late))
        assert not vigilance.look(memory, min(step, late))
    for gone in range(1, BLIND_STEPS + 2):
        memory.remember(3 * late + gone - 1, {"a": OWN}, age_steps=late)
        assert vigilance.look(memory, late) == (gone > BLIND_STEPS)
