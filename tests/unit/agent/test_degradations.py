"""How a robot says that it is degraded, and what it drives then; and where it is when nobody believes it."""

import math
from collections.abc import Mapping

import numpy as np
import pytest
from agent_helpers import agent_of, euler, scene_of, seen

from agent.agent import Decision
from agent.drive.reserve import Reserve
from agent.drive.safety import BLIND_STEPS, LastResort
from agent.remember.memory import LONGEST_GAP
from agent.remember.perception import REACQUIRED_AFTER
from protocol.scene import Goal
from protocol.vehicle import Limits, braking_input

Place = tuple[float, float, float, float]
A: Place = (-4.0, 0.0, 0.0, 2.0)
B: Place = (4.0, 3.0, math.pi, 0.0)
"""It stands beside the way of a."""
GOAL = Goal(x_m=6.0, y_m=0.0, heading_rad=0.0)
LIMITS = Limits()


class Drive:
    """Robot a in closed loop from step to step, wherever it is told to be."""

    def __init__(self) -> None:
        self.agent = agent_of(GOAL, scene_of("ab"))
        self.state = A
        self.step = 0
        self.previous = (0.0, 0.0)

    def on(
        self, others: Mapping[str, Place] = {"b": B}, *, own: Place | None = None, age_steps: int = 0
    ) -> Decision:
        states = {"a": own or self.state, **others}
        told = seen(self.step, states, age_steps=min(age_steps, self.step))
        decision = self.agent.decide(told)
        assert decision is not None
        self.previous = decision.command.input
        self.state = tuple(euler(self.state, [self.previous])[-1].tolist())
        self.step += 1
        return decision

    def braking(self) -> tuple[float, float]:
        """What braking at the present step would drive."""
        return braking_input(LIMITS, self.previous, self.state[3], 0.1)


@pytest.mark.parametrize("age_steps", [0, 2])
def test_who_is_not_seen_or_not_believed_is_extrapolated_until_it_is_seen_again(age_steps):
    """A robot that sees everybody, if late as it is said, is not degraded."""
    drive = Drive()
    views: list[dict[str, Place]] = [{"b": B}] * 3 + [{}, {}, {"b": B}, {"b": (0.0, 0.5, *B[2:])}, {"b": B}]
    minds = [drive.on(view, age_steps=age_steps).mind for view in views]
    expected = [(), (), (), ("extrapolation",), ("extrapolation",), (), ("extrapolation", "gate"), ()]
    assert [mind.degraded for mind in minds] == expected
    assert minds[6].prediction["b"][0] == pytest.approx(B[:2]), "where it should be"


def test_the_stop_for_want_of_sight_is_told_and_brakes():
    drive = Drive()
    for step in range(3):
        drive.on({"b": (3.0 - 0.2 * step, 0.3, math.pi, 2.0)})
    blind = [drive.on({}).mind.degraded for _ in range(BLIND_STEPS)]
    assert all("extrapolation" in each and "controlled stop" not in each for each in blind)
    braking = drive.braking()
    stopping = drive.on({})
    assert stopping.mind.degraded == ("extrapolation", "controlled stop")
    assert stopping.command.input == braking


def test_an_intervention_is_told_and_brakes(monkeypatch):
    drive = Drive()
    drive.on()
    braking = drive.braking()
    with monkeypatch.context() as dangerous:
        dangerous.setattr(Reserve, "doubted", lambda *_: ["b"])
        dangerous.setattr(LastResort, "must_brake", lambda *_: True)
        decision = drive.on()
    assert decision.mind.degraded == ("intervention",)
    assert decision.command.input == braking
    assert drive.on().mind.degraded == ()


def test_a_robot_whose_own_pose_jumps_goes_on_from_where_its_inputs_have_led_it():
    drive, honest = Drive(), Drive()
    for each in (drive, honest):
        for _ in range(4):
            each.on()
    jumps = [(3.0, 5.0, 1.0, 0.0), (-9.0, -2.0, 0.0, 1.0), (8.0, -7.0, -1.0, 3.0)]
    for jump in jumps:
        here = drive.state
        lost = drive.on(own=jump)
        assert lost.mind.degraded == ("gate",)
        assert lost.mind.plan[0] == pytest.approx(here[:2], abs=1e-9)
        assert lost.command.input == pytest.approx(honest.on().command.input, abs=1e-6)
    assert drive.on().mind.degraded == ()


def test_a_robot_that_cannot_know_where_it_is_decides_nothing():
    """Its poses jump and it has given no command that it could go on from; then they fit again."""
    agent = agent_of(GOAL, scene_of("ab"))
    answered = []
    for step in range(LONGEST_GAP + 4):
        angle = 2.4 * step
        jump = (-4.0 + 5.0 * math.cos(angle), 5.0 * math.sin(angle), 0.0, 2.0) if step else A
        decision = agent.decide(seen(step, {"a": jump, "b": B}))
        answered.append(decision is not None)
        if decision is not None:
            agent.withdraw()
    assert answered == [True] * (LONGEST_GAP + 1) + [False] * 3
    way = euler((1.0, 1.0, 0.0, 2.0), np.zeros((REACQUIRED_AFTER, 2)))
    first = LONGEST_GAP + 4
    decisions = [agent.decide(seen(first + ahead, {"a": here, "b": B})) for ahead, here in enumerate(way)]
    assert [decision is not None for decision in decisions] == [False, False, True, True]
