"""Files of faults, and faults in scenarios: read, refused in words, and written."""

import re
from pathlib import Path
from typing import Any

import pytest
from faults_helpers import faults_of
from hypothesis import given, settings
from hypothesis import strategies as st

import protocol.scenario
from chassis.refusal import Refusal
from fleet.inject.fault import KINDS
from fleet.inject.scenario import Scenario, load_scenario, with_faults
from protocol.scenario import MAX_FAULTS, scenario_text
from scenarios import find

CROSSING = load_scenario(find("2-crossing"))
ALL_KINDS = "the kinds are arrives-late, bias, chases, "


def refusal(folder: Path, text: str) -> list[str]:
    path = folder / "broken.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(Refusal) as raised:
        with_faults(CROSSING, path)
    return str(raised.value).removeprefix(str(folder) + "/").replace(f"\n{folder}/", "\n").split("\n")


def test_the_faults_of_a_file_come_after_those_of_the_scenario(tmp_path: Path) -> None:
    path = tmp_path / "faults.yaml"
    path.write_text(
        "faults:\n"
        "  - {kind: loss, rate: 0.1, robots: [1, '2'], start_s: 3, duration_s: 4.5}\n"
        "  - kind: leaves\n"
        "    robots: [2]\n"
        "    start_s: [1, 2.5]\n"
    )
    once = with_faults(CROSSING, path)
    assert [fault.kind for fault in once.faults] == ["loss", "leaves"]
    assert once.faults[0].robots == ("1", "2")
    assert (once.faults[0].start_s, once.faults[1].start_s) == (3.0, (1.0, 2.5))
    twice = with_faults(once, path)
    assert twice.faults == once.faults * 2
    assert twice.robots == CROSSING.robots


@pytest.mark.parametrize(
    ("faults", "told"),
    [
        ("[{rate: 1}]", f"faults[0].kind: this field is missing; {ALL_KINDS}"),
        ("[{kind: loss, rate: 1, rat: 2}]", "faults[0].rat: there is no such field; did you mean 'rate'?"),
        ("[{kind: loss, rate: 1.5}]", "faults[0].rate: "),
        ("[{kind: loss, rate: 1}, {kind: loss, rate: 1, start_s: soon}]", "faults[1].start_s: "),
        ("[{kind: loss, rate: 1, start_s: [1, soon]}]", "faults[0].start_s[1]: "),
        ("[{kind: loss, rate: 1, start_s: [1]}]", "faults[0].start_s[1]: this item is missing"),
        ("[{kind: loss, rate: 1, start_s: [3, 1]}]", "faults[0].start_s: the first time of the interval"),
        ("[{kind: loss, rate: 1, robots: 1}]", "faults[0].robots: "),
        ("[{kind: kill, robots: [1, 3]}]", "faults[0].robots[1]: there is no robot '3'; the robots are 1, 2"),
        ("[{kind: stuck, seen: two}]", "faults[0].seen: there is no robot 'two'; the robots are 1, 2"),
        ("[{kind: other-cost, robots: [1], weights: {z: 1}}]", "faults[0].weights.z: there is no such field"),
    ],
)
def test_a_mistake_in_a_file_or_a_scenario_is_told_in_one_line_with_its_place(
    tmp_path: Path, faults: str, told: str
) -> None:
    (line,) = refusal(tmp_path, f"faults: {faults}\n")
    assert line.startswith(f"broken.yaml:1: {told}")
    path, text = tmp_path / "hall.yaml", scenario_text(CROSSING)
    path.write_text(f"{text}faults: {faults}\n")
    with pytest.raises(Refusal) as raised:
        load_scenario(path)
    assert str(raised.value).startswith(f"{path}:{text.count(chr(10)) + 1}: {told}")


def test_several_mistakes_are_told_in_the_order_of_the_file(tmp_path: Path) -> None:
    lines = refusal(tmp_path, "faults:\n- {kind: los}\n- {kind: loss}\n- {kind: jump, seen: 1, rate: 1}\n")
    assert [re.split(": ", line)[:2] for line in lines] == [
        ["broken.yaml:2", "faults[0].kind"],
        ["broken.yaml:3", "faults[1].rate"],
        ["broken.yaml:4", "faults[2].distance_m"],
    ]


def test_too_many_faults_together_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "many.yaml"
    path.write_text("faults:\n" + "- {kind: loss, rate: 1}\n" * MAX_FAULTS)
    full = with_faults(CROSSING, path)
    with pytest.raises(Refusal, match=rf"{2 * MAX_FAULTS} faults.*at most {MAX_FAULTS}"):
        with_faults(full, path)


def written(path: Path, faults: list[dict[str, Any]]) -> tuple[Scenario, Scenario]:
    """A scenario with faults, and what is read of it once it is written."""
    scenario = Scenario.model_validate({**dict(CROSSING), "faults": faults})
    path.write_text(scenario_text(scenario), encoding="utf-8")
    return scenario, load_scenario(path)


@settings(max_examples=10)
@given(faults=st.tuples(*(faults_of([kind]) for kind in KINDS)).map(list))
def test_faults_of_every_kind_are_read_back_as_they_are_written(
    tmp_path_factory: pytest.TempPathFactory, faults: list[dict[str, Any]]
) -> None:
    scenario, read = written(tmp_path_factory.getbasetemp() / "written.yaml", faults)
    assert read == scenario
    assert repr(read) == repr(scenario)
    assert [type(each) for each in read.faults] == list(KINDS.values())


def test_a_fault_is_written_in_a_line_that_begins_with_its_kind() -> None:
    faults = [{"kind": "nan", "rate": 1.0, "robots": ["1"], "start_s": [1.0, 2.0]}, {"kind": "pause"}]
    scenario = Scenario.model_validate({**dict(CROSSING), "faults": faults})
    assert scenario_text(scenario) == scenario_text(CROSSING) + (
        "faults:\n  - {kind: nan, start_s: [1, 2], robots: [1], rate: 1}\n  - {kind: pause}\n"
    )


def test_a_world_alone_reads_a_scenario_without_knowing_its_faults(tmp_path: Path) -> None:
    path = tmp_path / "hall.yaml"
    path.write_text(scenario_text(CROSSING) + "faults: [{kind: of another bench, since: 3}]\n")
    alone = protocol.scenario.load_scenario(path)
    assert alone.robots == CROSSING.robots
    assert protocol.scenario.load_scenario(path, scenario_text(alone)) == alone
