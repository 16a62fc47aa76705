"""The summary of a run, counted by hand, and what the terminal says of it."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from run_helpers import FACTS, mind, truth

from fleet.record.recording import Recorder, RefusedMind, Restarted, read_recording
from fleet.record.summary import Summary, Tally, remarks, robot_table, verdict_line
from protocol.messages import Message


def summarise(items: Iterable[Message | RefusedMind | Restarted], without: str = "interrupted") -> Summary:
    tally = Tally()
    for item in items:
        tally.add(item)
    return tally.summary(FACTS, without)


CROSSING = [
    truth(0, {"a": {}, "b": {}}, minimum_distance_m=8.0),
    mind("a", 0, timings_ms={"plan": 10.0, "decide": 12.0}),
    mind("b", 0, timings_ms={"plan": 20.0, "decide": 24.0}, solver_failures=1),
    truth(1, {"a": {"arrived_s": 0.1, "driven_m": 1.5}, "b": {}}, minimum_distance_m=1.25),
    mind("a", 1, timings_ms={"decide": 0.5}),
    mind("b", 1, timings_ms={"plan": 40.0, "decide": 50.0}, solver_failures=3),
    truth(
        2,
        {
            "a": {"arrived_s": 0.1, "driven_m": 1.5, "deadline_misses": 2},
            "b": {"arrived_s": 0.2, "driven_m": 2.5, "deadline_misses": 3, "clipped_commands": 4},
        },
        minimum_distance_m=1.25,
        collisions=(("a", "b"),),
        verdict="arrived",
    ),
]
"""Two robots over two steps, every number chosen."""


def test_the_summary_counts_a_run_exactly() -> None:
    content = json.loads(summarise(CROSSING).model_dump_json(by_alias=True))
    phases = content.pop("phases_ms")
    assert content == {
        "schema": 1,
        "scenario": "8a",
        "goals": "ioc",
        "solver": "reference",
        "iterations": 2,
        "budget_ms": None,
        "reserve": True,
        "clock": "lockstep",
        "seed": 3,
        "verdict": "arrived",
        "duration_s": 0.2,
        "steps": 2,
        "collisions": 1,
        "minimum_distance_m": 1.25,
        "solver_failures": 3,
        "deadline_misses": 5,
        "clipped_commands": 4,
        "refused": {},
        "interventions": 0,
        "degraded": {},
        "restarts": {},
        "relative_distances": None,
        "side_disagreement": None,
        "side_pair_steps": 0,
        "warnings": [],
        "robots": [
            {"id": "a", "arrived_s": 0.1, "driven_m": 1.5, "solver_failures": 0, "deadline_misses": 2},
            {"id": "b", "arrived_s": 0.2, "driven_m": 2.5, "solver_failures": 3, "deadline_misses": 3},
        ],
    }
    # Of 10, 20, 40: the middle one, and 98 % of the way from the middle to the last.
    assert phases["plan"] == pytest.approx({"p50": 20.0, "p99": 39.6, "max": 40.0})
    assert phases["decide"] == pytest.approx({"p50": 18.0, "p99": 49.22, "max": 50.0})
    assert phases["predict"] == {"p50": None, "p99": None, "max": None}


def test_a_run_without_reserve_says_so_and_who_does_not_say_had_it() -> None:
    summary = summarise(CROSSING)
    content = summary.model_dump(by_alias=True)
    assert not any("reserve" in remark for remark in remarks(summary))
    assert remarks(Summary(**content | {"reserve": False})) == ["All drove without reserve."]
    del content["reserve"]
    assert Summary(**content).reserve


def test_what_was_refused_is_counted_by_robot_and_reason() -> None:
    summary = summarise(
        [
            truth(0, {"a": {}, "b": {}}, refused={"a": {"not a valid message": 2}}),
            truth(1, {"a": {}, "b": {}}, refused={"a": {"not a valid message": 5}}),
            RefusedMind("a", "not a valid message"),
            RefusedMind("b", "answers a step again"),
            RefusedMind("b", "answers a step again"),
            RefusedMind("b", "too many at once", 7),
        ]
    )
    assert summary.refused == {
        "a": {"not a valid message": 5, "mind: not a valid message": 1},
        "b": {"mind: answers a step again": 2, "mind: too many at once": 7},
    }
    assert "mind: answers a step again" in remarks(summary)[1]


def test_degradations_are_summed_up_in_seconds_and_told() -> None:
    """And interventions are those that the robots have counted, each for itself."""
    told: dict[str, list[tuple[str, ...]]] = {
        "a": [("extrapolation",), ("extrapolation", "gate"), (), ("extrapolation", "intervention")],
        "b": [(), (), ("solver failure",), ()],
        "c": [()] * 4,
    }
    counted = {"a": [0, 1, 1, 3], "b": [0, 0, 2, 2], "c": [0] * 4}
    messages: list[Message] = []
    for step in range(4):
        messages.append(truth(step, {name: {} for name in told}))
        for name in told:
            messages.append(mind(name, step, degraded=told[name][step], interventions=counted[name][step]))
    summary = summarise([*messages, truth(4, {name: {} for name in told}, verdict="timeout")])
    assert summary.degraded == {
        "a": {"extrapolation": 0.3, "gate": 0.1, "intervention": 0.1},
        "b": {"solver failure": 0.1},
    }
    assert summary.interventions == 5
    assert remarks(summary)[1] == "Robot b was degraded: solver failure 0.1 s."
    assert remarks(summarise(CROSSING)) == []


def test_a_robot_that_vanished_keeps_its_part() -> None:
    before = truth(1, {"1": {"driven_m": 1.0, "clipped_commands": 2}, "2": {}})
    summary = summarise([before, truth(2, {"2": {"arrived_s": 0.2}})])
    assert [(robot.id, robot.driven_m) for robot in summary.robots] == [("1", 1.0), ("2", 0.0)]
    assert summary.clipped_commands == 2
    assert summary.duration_s is None


@pytest.mark.parametrize(
    ("robots", "verdict", "without", "expected"),
    [
        (None, None, "interrupted", ("interrupted", 0, None, [])),  # before any truth
        ({"1": {}}, None, "failed", ("failed", 9, None, [None])),
        ({"1": {"arrived_s": 0.5}}, "arrived", "failed", ("arrived", 9, 0.5, [0.5])),  # the referee's stands
        ({"1": {"arrived_s": 0.5}, "2": {}}, "deadlock", "failed", ("deadlock", 9, None, [0.5, None])),
    ],
)
def test_the_verdict_and_the_duration_however_a_run_ended(
    robots: Any, verdict: Any, without: str, expected: tuple[Any, ...]
) -> None:
    summary = summarise([] if robots is None else [truth(9, robots, verdict=verdict)], without)
    arrivals = [robot.arrived_s for robot in summary.robots]
    assert (summary.verdict, summary.steps, summary.duration_s, arrivals) == expected


def test_a_recording_gives_the_same_summary_as_the_run_and_so_does_its_file(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.mcap", FACTS, "") as recorder:
        for message in CROSSING:
            recorder.record("unspoken/test/anything", message, 0)
    recorded = summarise(message for _, message in read_recording(tmp_path / "run.mcap"))
    assert recorded == summarise(CROSSING)
    assert Summary.model_validate_json(recorded.model_dump_json(by_alias=True)) == recorded


def test_after_a_restart_of_the_world_its_last_epoch_counts() -> None:
    former = [message.model_copy(update={"epoch": 1}) for message in CROSSING]
    former.append(mind("a", 2, degraded=("gate",), interventions=1, epoch=1))
    anew = summarise([*former, *CROSSING[:3], Restarted("world")])
    assert anew == summarise(CROSSING[:3]).model_copy(update={"restarts": {"world": 1}})


PAIR = (("1", "2"),)


@pytest.mark.parametrize(
    ("arrived_s", "verdict", "collisions", "line"),
    [
        ((5.0, 5.4), "arrived", (), "Both robots arrived after 5.4 s without collision; "),
        ((5.0, 5.4), "arrived", PAIR, "Both robots arrived after 5.4 s, but 1 pair of robots collided; "),
        ((5.0, None, None), "deadlock", (), "Deadlock after 5.4 s: robots 2 and 3 never arrived; "),
        ((5.0, None), None, (), "Interrupted after 5.4 s: robot 2 had not arrived; "),
    ],
)
def test_the_verdict_is_a_plain_sentence(arrived_s: Any, verdict: Any, collisions: Any, line: str) -> None:
    states = {str(number): {"arrived_s": each} for number, each in enumerate(arrived_s, 1)}
    last = truth(54, states, verdict=verdict, collisions=collisions)
    assert verdict_line(summarise([last]), step_s=0.1) == f"{line}smallest distance 1.50 m."


def test_a_verdict_without_a_distance_or_a_step_is_a_sentence_too() -> None:
    alone = truth(50, {"1": {"arrived_s": 5.0}}, verdict="arrived", minimum_distance_m=None)
    assert verdict_line(summarise([alone]), 0.1) == "The robot arrived after 5.0 s."
    assert verdict_line(summarise([]), 0.1) == "Interrupted before the first step."
    two_pairs = truth(9, {"1": {}}, verdict="deadlock", collisions=(*PAIR, ("3", "4")))
    assert verdict_line(summarise([two_pairs]), 0.1).endswith("1.50 m. 2 pairs of robots collided.")


def printed(tally: Tally) -> list[str]:
    console = Console(width=80)
    with console.capture() as capture:
        console.print(robot_table(tally.summary(FACTS), tally.clipped_commands))
    return capture.get().splitlines()


def test_the_table_has_a_row_for_every_robot_and_their_sum() -> None:
    tally = Tally()
    robots = {"1": {"arrived_s": 2.9, "driven_m": 8.126, "deadline_misses": 7}}
    robots["2"] = {"driven_m": 5.0, "clipped_commands": 11}
    tally.add(truth(30, robots))
    tally.add(mind("2", 30, solver_failures=4))
    rows = [line.split() for line in printed(tally)]
    assert ["1", "2.9", "8.13", "0", "7", "0"] in rows
    assert ["2", "–", "5.00", "4", "0", "11"] in rows
    assert ["all", "–", "13.13", "4", "7", "11"] in rows


def test_the_table_of_many_robots_with_long_names_fits_into_80_columns() -> None:
    names, tally = [f"a-robot-with-a-long-name-no-{i:04}" for i in range(16)], Tally()
    tally.add(truth(122, {name: {"arrived_s": 12.2} for name in names}, verdict="arrived"))
    lines = printed(tally)
    assert max(map(len, lines)) <= 80
    first_column = "".join(line[:26].strip() for line in lines)
    assert all(name in first_column for name in names), "folded, but not shortened"
