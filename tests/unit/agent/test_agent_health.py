"""What a robot's process tells of itself, as it is reported by the loop."""

import pytest
from agent_helpers import mind_of, seen

from agent.process.health import LONGEST_QUIET_S, RobotHealth
from protocol.messages import State, Timings
from protocol.scene import Goal


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def health():
    return RobotHealth("a", Goal(x_m=4.0, y_m=0.0, heading_rad=0.0), now_s=Clock())


def mind(step=0, *, goals=None, **told):
    goals = {"a": (4.0, 3.0), "b": (0.0, 0.0)} if goals is None else goals
    estimates = {robot: State.of(x, y, 0.0, 0.0) for robot, (x, y) in goals.items()}
    timings = Timings(estimate=1.5, predict=3.0, plan=4.0, decide=9.0)
    return mind_of(step, **{"estimates": estimates, "timings_ms": timings, **told})


def values(health):
    """By name and labels, such as ``degraded{gate}``."""
    return {
        sample.name.removeprefix("unspoken_agent_")
        + (f"{{{','.join(sample.labels.values())}}}" if sample.labels else ""): sample.value
        for metric in health.collect()
        for sample in metric.samples
    }


def test_it_is_ready_from_joining_on_as_long_as_decisions_come(health):
    health.beat()
    health.wants("it waits for a world")
    assert health.why_not_ready() == "it waits for a world"
    health.joined(2)
    health.now_s.now_s += LONGEST_QUIET_S + 5.0
    health.beat()
    assert health.why_not_ready() is None  # before step 0 nothing can come
    health.decided(mind())
    assert health.why_not_ready() is None
    health.now_s.now_s += LONGEST_QUIET_S + 5.0
    health.beat()
    assert health.why_not_ready() == "no decision for 15 s"
    health.joined(2)
    assert health.why_not_ready() is None


def test_decisions_are_counted_by_their_phases_and_states(health):
    health.joined(2)
    health.decided(mind(degraded=("gate", "solver failure"), cut_short_at=3))
    health.decided(mind(1, degraded=("gate",), interventions=2, solver_failures=4))
    health.decided(mind(2, timings_ms=Timings(decide=0.1), arrived=True))
    health.observed(seen(7, {"a": (0.0, 0.0, 0.0, 0.0)}))
    health.now_s.now_s += 1.5
    expected = {
        "decision_seconds_count{estimate}": 2.0,
        "decision_seconds_count{decide}": 3.0,
        "decision_seconds_sum{plan}": pytest.approx(0.008),
        "decision_seconds_bucket{predict,0.001}": 0.0,
        "decision_seconds_bucket{predict,0.005}": 2.0,
        "degraded_decisions_total{gate}": 2.0,
        "degraded_decisions_total{intervention}": 0.0,
        "degraded{gate}": 0.0,
        "cut_short_decisions_total": 1.0,
        "decisions_total": 3.0,
        "arrived": 1.0,
        "observation_age_seconds": 1.5,
        "robots_seen": 1.0,
    }
    told = values(health)
    assert {name: told[name] for name in expected} == expected
    health.decided(mind(3, degraded=("gate",), interventions=2, solver_failures=4))
    expected = {"degraded{gate}": 1.0, "interventions_total": 2.0, "solver_failures_total": 4.0}
    told = values(health)
    assert {name: told[name] for name in expected} == expected


def test_estimates_are_held_against_the_one_goal_that_it_knows_and_against_the_last_ones(health):
    def told():
        """Of its own goal's error and of the changes of a, b and c."""
        names = ("own_goal_error_meters", *(f"estimate_change_meters{{{robot}}}" for robot in "abc"))
        return [values(health).get(name) for name in names]

    health.joined(2)
    health.decided(mind(0))
    assert told() == [3.0, None, None, None]
    health.decided(mind(1, goals={"a": (4.0, 1.0), "b": (3.0, 4.0), "c": (9.0, 9.0)}))
    assert told() == [1.0, 2.0, 5.0, None]
    health.joined(2)
    assert told() == [None] * 4
