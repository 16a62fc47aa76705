"""What has to hold in a trial: each violation is found, and nothing where all is well."""

from typing import Any

from fleet.faults.cases import Case, Evidence, lost_steps, violations
from fleet.inject.link import Loss
from fleet.inject.process_faults import Leaves
from fleet.inject.scenario import Scenario
from protocol.messages import State, TrueRobot, Truth
from protocol.scenario import Pose, ScenarioRobot

SCENARIO = Scenario(
    name="lanes",
    robots=[
        ScenarioRobot(id=str(i), start=Pose(x_m=0.0, y_m=3.0 * i), goal=Pose(x_m=4.0, y_m=3.0 * i))
        for i in (1, 2)
    ],
)
STEPS = 12
LATE = 5


def case(**rules: Any) -> Case:
    fault = {"robots": ("1",), "start_s": 0.1 * LATE, "duration_s": 0.2}
    return Case(name="lost", faults=(Loss(kind="loss", rate=1.0, **fault),), **rules)


def truth(step: int, last: int = STEPS, without: tuple[str, ...] = (), **changes: Any) -> Truth:
    """Both drive abreast, and arrive at the last step, except those without."""
    nothing = dict.fromkeys(("turn_rate_radps", "acceleration_mps2", "driven_m"), 0.0)
    nothing |= dict.fromkeys(("deadline_misses", "clipped_commands"), 0)
    robots = {
        name: TrueRobot(
            state=State.of(0.3 * step, 3.0 * int(name), 0.0, 3.0),
            arrived_s=0.1 * last if step == last and name not in without else None,
            **nothing,
        )
        for name in "12"
    }
    plain = {"minimum_distance_m": 3.0, "collisions": (), "refused": {}}
    plain["verdict"] = "arrived" if step == last else None
    return Truth(epoch=0, step=step, time_s=round(0.1 * step, 9), robots=robots, **plain | changes)


def evidence(*truths: Truth, degraded: dict[tuple[int, str], tuple[Any, ...]] | None = None) -> Evidence:
    found = Evidence(truths or [truth(step) for step in range(STEPS + 1)])
    found.epochs[0].degraded.update(degraded or {})
    return found


def told(found: Evidence, **rules: Any) -> list[str]:
    return violations(case(**rules), SCENARIO, 0, found)


def test_nothing_is_told_where_all_is_well():
    meanwhile = {(LATE, "1"): ("extrapolation",), (1, "2"): ("intervention",)}
    assert told(evidence(degraded=meanwhile), everybody_arrives=True, no_collision=True, settles_s=0.2) == []


def test_a_gap_and_a_missing_verdict_are_told():
    gap = evidence(*(truth(step) for step in range(STEPS + 1) if step != 4))
    assert told(gap) == [f"the record lacks steps: {STEPS} of {STEPS + 1} are there"]
    cut = evidence(*(truth(step, last=99) for step in range(4)))
    assert "the run has no verdict" in told(cut)
    assert lost_steps(Evidence()) == ["nothing was recorded"]
    assert violations(case(), SCENARIO, 0, Evidence()) == ["nothing was recorded"]


def test_what_is_amiss_before_the_fault_is_told():
    early = told(evidence(degraded={(LATE - 1, "2"): ("gate",)}))
    assert early == ["robot 2 was degraded before the fault: gate"]
    touching = [truth(step, collisions=(("1", "2"),) if step >= 2 else ()) for step in range(STEPS + 1)]
    assert "robots collided before the fault" in told(evidence(*touching))


def test_a_collision_is_told_where_none_may_be():
    touching = [truth(step, collisions=(("1", "2"),) if step >= 9 else ()) for step in range(STEPS + 1)]
    assert told(evidence(*touching), no_collision=True) == ["robots 1 and 2 collided"]


def test_who_did_not_arrive_is_told_if_it_had_to():
    befallen, healthy = (evidence(*map(truth, range(STEPS)), truth(STEPS, without=(name,))) for name in "12")
    assert told(befallen) == []
    assert told(befallen, everybody_arrives=True) == ["robot 1 did not arrive"]
    assert told(healthy) == ["robot 2 did not arrive"]


def test_an_effect_that_does_not_end_is_told():
    late = evidence(degraded={(LATE + 6, "2"): ("controlled stop",)})
    assert told(late, settles_s=0.3) == ["robot 2 was degraded 0.4 s after the fault: controlled stop"]
    assert told(late, settles_s=0.5) == []
    assert told(late) == []


def test_a_fault_for_good_has_no_end_to_settle_after():
    forever = Case(name="gone", faults=(Leaves(kind="leaves", robots=("1",)),), settles_s=0.1)
    assert violations(forever, SCENARIO, 0, evidence(degraded={(9, "2"): ("extrapolation",)})) == []
