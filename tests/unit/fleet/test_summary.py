"""The summary of a run, counted by hand."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from fleet.record.recording import Recorder, read_recording
from fleet.record.stream import RefusedMind, Restarted
from fleet.record.summary import Summary, Tally
from fleet.run.experiment import RunFacts
from protocol.messages import Message


def summarise(
    facts: RunFacts, messages: Iterable[Message], without_verdict: str = "interrupted"
) -> dict[str, Any]:
    tally = Tally()
    for message in messages:
        tally.add(message)
    content: dict[str, Any] = json.loads(tally.summary(facts, without_verdict).model_dump_json(by_alias=True))
    return content


@pytest.fixture
def crossing(make_truth: Any, make_mind: Any) -> list[Message]:
    """Two robots over two steps, every number chosen."""
    return [
        make_truth(0, {"a": {}, "b": {}}, minimum_distance_m=8.0),
        make_mind("a", 0, timings_ms={"plan": 10.0, "decide": 12.0}),
        make_mind("b", 0, timings_ms={"plan": 20.0, "decide": 24.0}, solver_failures=1),
        make_truth(1, {"a": {"arrived_s": 0.1, "driven_m": 1.5}, "b": {}}, minimum_distance_m=1.25),
        make_mind("a", 1, timings_ms={"decide": 0.5}),
        make_mind("b", 1, timings_ms={"plan": 40.0, "decide": 50.0}, solver_failures=3),
        make_truth(
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


def test_the_summary_counts_a_run_exactly(facts: RunFacts, crossing: list[Message]) -> None:
    content = summarise(facts, crossing)
    phases = content.pop("phases_ms")
    assert content == {
        "schema": 1,
        "scenario": "8a",
        "goals": "ioc",
        "solver": "reference",
        "iterations": 2,
        "budget_ms": None,
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
        "robots": [
            {"id": "a", "arrived_s": 0.1, "driven_m": 1.5, "solver_failures": 0, "deadline_misses": 2},
            {"id": "b", "arrived_s": 0.2, "driven_m": 2.5, "solver_failures": 3, "deadline_misses": 3},
        ],
    }
    # Of 10, 20, 40: the middle one, and 98 % of the way from the middle to the last.
    assert phases["plan"] == pytest.approx({"p50": 20.0, "p99": 39.6, "max": 40.0})
    assert phases["decide"] == pytest.approx({"p50": 18.0, "p99": 49.22, "max": 50.0})
    assert phases["predict"] == {"p50": None, "p99": None, "max": None}


def test_what_was_refused_is_counted_by_robot_and_reason(facts: RunFacts, make_truth: Any) -> None:
    tally = Tally()
    tally.add(make_truth(0, {"a": {}, "b": {}}, refused={"a": {"not a valid message": 2}}))
    tally.add(make_truth(1, {"a": {}, "b": {}}, refused={"a": {"not a valid message": 5}}))
    for refused in (
        RefusedMind("a", "not a valid message"),
        RefusedMind("b", "answers a step again"),
        RefusedMind("b", "answers a step again"),
        RefusedMind("b", "too many at once", 7),
    ):
        tally.refuse(refused)
    assert tally.summary(facts).refused == {
        "a": {"not a valid message": 5, "mind: not a valid message": 1},
        "b": {"mind: answers a step again": 2, "mind: too many at once": 7},
    }


def test_degradations_are_summed_up_in_seconds_by_robot_and_kind(
    facts: RunFacts, make_truth: Any, make_mind: Any
) -> None:
    """And interventions are those that the robots have counted, each for itself."""
    told: dict[str, list[tuple[str, ...]]] = {
        "a": [("extrapolation",), ("extrapolation", "gate"), (), ("extrapolation", "intervention")],
        "b": [(), (), ("solver failure",), ()],
        "c": [()] * 4,
    }
    counted = {"a": [0, 1, 1, 3], "b": [0, 0, 2, 2], "c": [0] * 4}
    messages: list[Message] = []
    for step in range(4):
        messages.append(make_truth(step, {name: {} for name in told}))
        messages += [
            make_mind(name, step).model_copy(
                update={"degraded": told[name][step], "interventions": counted[name][step]}
            )
            for name in told
        ]
    messages.append(make_truth(4, {name: {} for name in told}, verdict="timeout"))
    content = summarise(facts, messages)
    assert content["degraded"] == {
        "a": {"extrapolation": 0.3, "gate": 0.1, "intervention": 0.1},
        "b": {"solver failure": 0.1},
    }
    assert content["interventions"] == 5


def test_degradations_of_an_earlier_epoch_do_not_count(
    facts: RunFacts, make_truth: Any, make_mind: Any
) -> None:
    degraded = make_mind("a", 0).model_copy(update={"degraded": ("gate",), "interventions": 1})
    begun_again = make_truth(1, {"a": {}}).model_copy(update={"epoch": 8})
    content = summarise(facts, [make_truth(0, {"a": {}}), degraded, begun_again])
    assert (content["degraded"], content["interventions"]) == ({}, 0)


def test_a_robot_that_vanished_keeps_its_part(facts: RunFacts, make_truth: Any) -> None:
    content = summarise(
        facts,
        [
            make_truth(1, {"1": {"driven_m": 1.0, "clipped_commands": 2}, "2": {}}),
            make_truth(2, {"2": {"arrived_s": 0.2}}),
        ],
    )
    assert [(robot["id"], robot["driven_m"]) for robot in content["robots"]] == [("1", 1.0), ("2", 0.0)]
    assert content["clipped_commands"] == 2
    assert content["duration_s"] is None


@pytest.mark.parametrize(
    ("robots", "verdict", "without", "expected"),
    [
        (None, None, "interrupted", ("interrupted", 0, None, [])),  # before any truth
        ({"1": {}}, None, "interrupted", ("interrupted", 9, None, [None])),
        ({"1": {}}, None, "failed", ("failed", 9, None, [None])),
        ({"1": {"arrived_s": 0.5}}, "arrived", "failed", ("arrived", 9, 0.5, [0.5])),  # the referee's stands
        ({"1": {"arrived_s": 0.5}, "2": {}}, "deadlock", "failed", ("deadlock", 9, None, [0.5, None])),
    ],
)
def test_the_verdict_and_the_duration_however_a_run_ended(
    facts: RunFacts, make_truth: Any, robots: Any, verdict: Any, without: str, expected: tuple[Any, ...]
) -> None:
    truths = [] if robots is None else [make_truth(9, robots, verdict=verdict)]
    content = summarise(facts, truths, without)
    arrivals = [robot["arrived_s"] for robot in content["robots"]]
    assert (content["verdict"], content["steps"], content["duration_s"], arrivals) == expected


def test_a_recording_gives_the_same_summary_as_the_run(
    tmp_path: Path, facts: RunFacts, crossing: list[Message]
) -> None:
    path = tmp_path / "run.mcap"
    with Recorder(path, facts, "") as recorder:
        for message in crossing:
            recorder.record("unspoken/test/anything", message, 0)
    recording = read_recording(path)
    assert summarise(recording.facts, (message for _, message in recording)) == summarise(facts, crossing)


def test_the_written_file_is_read_back_as_the_same_summary(
    tmp_path: Path, facts: RunFacts, crossing: list[Message]
) -> None:
    tally = Tally()
    for message in crossing:
        tally.add(message)
    summary = tally.summary(facts)
    path = tmp_path / "summary.json"
    summary.write(path)
    assert Summary.model_validate_json(path.read_text()) == summary
    assert next(iter(json.loads(path.read_text()))) == "schema"
    assert [file.name for file in tmp_path.iterdir()] == ["summary.json"]


def test_a_reader_of_the_old_summary_never_sees_a_part_of_the_new_one(
    tmp_path: Path, facts: RunFacts
) -> None:
    path = tmp_path / "summary.json"
    path.write_text("old")
    with path.open() as reader:
        Tally().summary(facts).write(path)
        assert reader.read() == "old"
    assert json.loads(path.read_text())["schema"] == 1


def test_a_summary_that_cannot_be_written_leaves_the_old_one(tmp_path: Path, facts: RunFacts) -> None:
    path = tmp_path / "summary.json"
    path.mkdir()
    with pytest.raises(OSError, match=r"summary\.json"):
        Tally().summary(facts).write(path)
    assert [file.name for file in tmp_path.iterdir()] == ["summary.json"]


def test_after_a_restart_of_the_world_its_last_epoch_counts(facts: RunFacts, crossing: list[Message]) -> None:
    former = [message.model_copy(update={"epoch": 1}) for message in crossing]
    anew = Tally()
    for message in (*former, *crossing[:3]):
        anew.add(message)
    anew.count_restart(Restarted("world"))
    alone = Tally()
    for message in crossing[:3]:
        alone.add(message)
    expected = alone.summary(facts).model_copy(update={"restarts": {"world": 1}})
    assert anew.summary(facts) == expected
