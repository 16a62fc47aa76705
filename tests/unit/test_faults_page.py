"""What the page on faults says is what there is: its kinds, its promises and its examples."""

import re
from pathlib import Path
from typing import get_args

import pytest
import yaml

from fleet.faults.cases import BUNDLED, Case, load_cases
from fleet.inject.fault import KINDS
from fleet.inject.scenario import load_scenario, with_faults
from protocol.messages import Degradation
from scenarios import find

PAGE = Path(__file__).parents[2] / "docs" / "faults.md"
RUN_IN_THE_PAGE = "4-crossing"
OF_MANY = {"kind", "start_s", "duration_s", "robots"}
SETTLES = re.compile(r"settles in ([\d.]+) s")


def table(title: str) -> list[list[str]]:
    """The rows of the first table beneath a heading, without their heads."""
    beneath = re.split(rf"^##+ {title}$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1]
    first = re.search(r"^\|[-| ]+\|\n((?:\|.*\|\n)+)", beneath, re.MULTILINE)
    assert first
    return [line.strip("| ").split(" | ") for line in first[1].splitlines()]


def code_in(text: str) -> list[str]:
    return re.findall(r"`([^`]+)`", text)


def examples(first_field: str) -> list[str]:
    blocks = re.findall(r"^```yaml\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [block for block in blocks if first_field in yaml.safe_load(block)]


def test_the_table_has_every_kind_once_with_all_its_fields() -> None:
    rows = [(kind, set(fields)) for kind, *fields in (code_in(first) for first, *_ in table("Kinds"))]
    assert sorted(kind for kind, _ in rows) == sorted(KINDS)
    assert dict(rows) == {name: set(kind.model_fields) - OF_MANY for name, kind in KINDS.items()}


@pytest.mark.parametrize("kind", KINDS)
def test_the_bundled_suite_has_every_kind_and_asks_for_what_the_page_promises(kind: str) -> None:
    [promised] = [row[-1] for row in table("Kinds") if code_in(row[0])[0] == kind]
    cases = [case for case in load_cases(BUNDLED) if any(fault.kind == kind for fault in case.faults)]
    assert cases
    assert ("all arrive" in promised) == any(case.everybody_arrives for case in cases)
    assert ("no collision" in promised) == any(case.no_collision for case in cases)
    assert {float(time_s) for time_s in SETTLES.findall(promised)} == {
        case.settles_s for case in cases if case.settles_s is not None
    }


def test_the_page_has_every_way_of_being_degraded_and_every_field_of_a_case() -> None:
    states = [code_in(first)[0] for first, *_ in table("What robots do about it")]
    assert states == list(get_args(Degradation))
    fields = [code_in(first)[0] for first, *_ in table("A suite of your own")]
    assert fields == list(Case.model_fields)


def test_the_examples_of_faults_can_be_used_with_the_scenario_that_the_page_runs(tmp_path: Path) -> None:
    scenario, texts = load_scenario(find(RUN_IN_THE_PAGE)), examples("faults")
    assert RUN_IN_THE_PAGE in PAGE.read_text(encoding="utf-8")
    assert texts
    for text in texts:
        path = tmp_path / "faults.yaml"
        path.write_text(text, encoding="utf-8")
        assert len(with_faults(scenario, path).faults) == len(yaml.safe_load(text)["faults"])


def test_the_examples_of_suites_can_be_used(tmp_path: Path) -> None:
    texts = examples("cases")
    assert texts
    for text in texts:
        path = tmp_path / "suite.yaml"
        path.write_text(text, encoding="utf-8")
        assert [case.name for case in load_cases(path)] == [
            case["name"] for case in yaml.safe_load(text)["cases"]
        ]
