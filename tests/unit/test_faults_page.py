"""What the page on faults says is what there is: its kinds, its promises and its examples."""

import re
from itertools import pairwise
from pathlib import Path
from typing import get_args

import pytest
import yaml
from markdown_it import MarkdownIt
from markdown_it.token import Token

from fleet.faults.cases import BUNDLED, Case, load_cases
from fleet.inject.fault import KINDS
from fleet.inject.scenario import load_scenario, with_faults
from protocol.messages import Degradation
from scenarios import find

PAGE = Path(__file__).parents[2] / "docs" / "faults.md"
RUN_IN_THE_PAGE = "4-crossing"
OF_MANY = {"kind", "start_s", "duration_s", "robots"}
SETTLES = re.compile(r"settles in ([\d.]+) s")


def tokens() -> list[Token]:
    return MarkdownIt().enable("table").parse(PAGE.read_text(encoding="utf-8"))


def section(title: str) -> list[Token]:
    """What stands between a heading and the next one."""
    page = tokens()
    [begin] = [
        index
        for index, (heading, text) in enumerate(pairwise(page))
        if heading.type == "heading_open" and text.content == title
    ]
    rest = page[begin + 3 :]
    end = next((index for index, token in enumerate(rest) if token.type == "heading_open"), len(rest))
    return rest[:end]


def table(title: str) -> list[list[str]]:
    """The rows of the first table in a section, without their heads."""
    types = [token.type for token in section(title)]
    body = section(title)[types.index("tbody_open") : types.index("tbody_close")]
    rows: list[list[str]] = []
    for token in body:
        if token.type == "tr_open":
            rows.append([])
        elif token.type == "inline":
            rows[-1].append(token.content)
    return rows


def code_in(text: str) -> list[str]:
    return re.findall(r"`([^`]+)`", text)


def examples(first_field: str) -> list[str]:
    blocks = [token.content for token in tokens() if token.type == "fence" and token.info == "yaml"]
    return [block for block in blocks if first_field in yaml.safe_load(block)]


def cases_of(kind: str) -> list[Case]:
    return [case for case in load_cases(BUNDLED) if any(fault.kind == kind for fault in case.faults)]


def test_the_table_has_every_kind_once_with_all_its_fields() -> None:
    rows = [(kind, set(fields)) for kind, *fields in (code_in(first) for first, *_ in table("Kinds"))]
    assert sorted(kind for kind, _ in rows) == sorted(KINDS)
    assert dict(rows) == {name: set(kind.model_fields) - OF_MANY for name, kind in KINDS.items()}


@pytest.mark.parametrize("kind", KINDS)
def test_the_bundled_suite_has_every_kind(kind: str) -> None:
    assert cases_of(kind)


@pytest.mark.parametrize("kind", KINDS)
def test_the_page_promises_what_the_bundled_suite_asks_for(kind: str) -> None:
    [promised] = [row[-1] for row in table("Kinds") if code_in(row[0])[0] == kind]
    cases = cases_of(kind)
    assert ("all arrive" in promised) == any(case.everybody_arrives for case in cases)
    assert ("no collision" in promised) == any(case.no_collision for case in cases)
    assert {float(time_s) for time_s in SETTLES.findall(promised)} == {
        case.settles_s for case in cases if case.settles_s is not None
    }


def test_the_page_has_every_way_in_which_a_robot_is_degraded() -> None:
    states = [code_in(first)[0] for first, *_ in table("What robots do about it")]
    assert states == list(get_args(Degradation))


def test_the_page_has_every_field_of_a_case() -> None:
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
