"""Every way a scenario file can be wrong is told with its line, what was found and what to do."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from chassis.refusal import Refusal
from chassis.yaml_file import MAX_FILE_BYTES
from protocol.scenario import Scenario, load_scenario

GOOD = """\
name: crossing
area: {x_min_m: -6}
horizons:
  prediction_steps: 20
robots:
  - id: 1
    start: {x_m: -4, y_m: 0}
    goal:
      x_m: 4
      y_m: 0
  - id: b
    start: {x_m: 1, y_m: -4}
    goal: {x_m: 1, y_m: 4, heading_rad: 1.57}
    limits:
      speed_mps: 2
    sensing: {range_m: 5}
"""

Load = Callable[[str | bytes], Scenario]


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Load:
    """Write a file called crossing.yaml and load it by its relative path."""
    monkeypatch.chdir(tmp_path)

    def write_and_load(content: str | bytes) -> Scenario:
        path = Path("crossing.yaml")
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return load_scenario(path)

    return write_and_load


def refusal(load: Load, content: str | bytes) -> list[str]:
    """The lines of the one exception with which a file is refused."""
    with pytest.raises(Refusal) as raised:
        load(content)
    return str(raised.value).splitlines()


def changed(old: str, new: str) -> str:
    """The good file with one change."""
    assert GOOD.count(old) == 1, old
    return GOOD.replace(old, new)


def test_a_good_file_says_what_is_written_in_it(load: Load) -> None:
    scenario = load(GOOD)
    first, second = scenario.robots
    assert (scenario.name, scenario.area.x_min_m, scenario.horizons.prediction_steps) == ("crossing", -6, 20)
    assert (first.id, first.start.x_m, first.goal.x_m, first.goal.heading_rad) == ("1", -4, 4, None)
    assert (second.id, second.limits.speed_mps, second.goal.heading_rad) == ("b", 2, 1.57)
    assert second.sensing is not None
    assert second.sensing.range_m == 5


WRONG_FIELDS = [
    # misspelt and unknown keys, at every level
    ("area: {", "aera: {", "2: aera: there is no such field; did you mean 'area'?"),
    ("prediction_steps", "predicton_steps", "did you mean 'prediction_steps'?"),
    ("    goal:\n", "    gaol:\n", "8: robots[0].gaol: there is no such field; did you mean 'goal'?"),
    ("speed_mps", "speed", "15: robots[1].limits.speed: there is no such field; did you mean 'speed_mps'?"),
    (
        "range_m: 5",
        "range: 5",
        "16: robots[1].sensing.range: there is no such field; did you mean 'range_m'?",
    ),
    (
        "heading_rad",
        "heading",
        "13: robots[1].goal.heading: there is no such field; did you mean 'heading_rad'?",
    ),
    ("area: {", "AREA: {", "2: AREA: there is no such field; did you mean 'area'?"),
    ("range_m: 5", "colour: 5", "the fields here are range_m, position_noise_m, heading_noise_rad, "),
    ("    limits:", "    1:", "14: robots[1].1: there is no such field; the fields here are "),
    # missing fields: the line of the map that lacks them
    ("name: crossing\n", "", "1: name: this field is missing"),
    ("      y_m: 0\n", "", "9: robots[0].goal.y_m: this field is missing"),
    ("  - id: b\n    start", "  - start", "11: robots[1].id: this field is missing"),
    # wrong types
    ("x_m: 4\n", "x_m: four\n", "9: robots[0].goal.x_m: a number is expected, found 'four'"),
    ("x_m: 4\n", "x_m: '4'\n", "9: robots[0].goal.x_m: a number is expected, found '4'; to make it a number"),
    ("x_m: 4\n", "x_m: 4e0\n", "found '4e0'; to make it a number write it without quotes, and powers of ten"),
    ("x_m: 4\n", "x_m: yes\n", "9: robots[0].goal.x_m: a number is expected, found yes"),
    ("x_m: 4\n", "x_m:\n", "9: robots[0].goal.x_m: a number is expected, found nothing"),
    ("x_m: 4\n", "x_m: [4]\n", "9: robots[0].goal.x_m: a number is expected, found a list of 1"),
    ("x_m: 4\n", "x_m: {}\n", "9: robots[0].goal.x_m: a number is expected, found a map"),
    ("x_m: 4\n", f"x_m: 1{'0' * 400}\n", "9: robots[0].goal.x_m: a number is expected, found 1000000000"),
    ("steps: 20", "steps: 2.5", "4: horizons.prediction_steps: a whole number is expected, found 2.5"),
    ("steps: 20", "steps: true", "4: horizons.prediction_steps: a whole number is expected, found true"),
    ("name: crossing", "name: 12", "1: name: text is expected, found 12; put it in quotes"),
    ("name: crossing", "name: 2026-01-31", "1: name: text is expected, found 2026-01-31; put it in quotes"),
    ("name: crossing", "name:", "1: name: text is expected, found nothing"),
    ("id: 1", "id: 1.5", "6: robots[0].id: text is expected, found 1.5; put it in quotes"),
    ("id: 1", "id: true", "6: robots[0].id: text is expected, found true; put it in quotes"),
    (
        "start: {x_m: -4, y_m: 0}",
        "start: -4",
        "7: robots[0].start: a map with x_m, y_m … is expected, found -4",
    ),
    (
        "{x_min_m: -6}",
        "small",
        "2: area: a map with x_min_m, x_max_m, y_min_m, y_max_m is expected, found 'small'",
    ),
    ("sensing: {range_m: 5}", "sensing: 5", "16: robots[1].sensing: a map with range_m, "),
    # values out of range
    ("x_m: 4\n", "x_m: .nan\n", "9: robots[0].goal.x_m: a finite number is expected, found .nan"),
    ("x_m: 4\n", "x_m: -.inf\n", "9: robots[0].goal.x_m: a finite number is expected, found -.inf"),
    ("x_m: 4\n", "x_m: 1.0e+7\n", "a number not greater than 1e+06 is expected, found 1.0e+7"),
    (
        "speed_mps: 2",
        "speed_mps: 0",
        "15: robots[1].limits.speed_mps: a number greater than 0 is expected, found 0",
    ),
    ("steps: 20", "steps: 1", "4: horizons.prediction_steps: a number not less than 2 is expected, found 1"),
    ("name: crossing", "name: ''", "1: name: text of at least 1 character is expected, found ''"),
    ("name: crossing", f"name: {'x' * 65}", "1: name: text of at most 64 characters is expected, found 'xxx"),
    (
        "id: b",
        "id: b/c",
        "11: robots[1].id: 1 to 32 letters, digits, '-' or '_', the first a letter or digit, is",
    ),
    # checks of the whole scenario
    ("id: b", "id: 1", "11: robots[1].id: the id '1' is used twice; ids must differ"),
    ("x_min_m: -6", "x_min_m: 10", "2: area: the area is empty: each minimum must lie below its maximum"),
    ("x_min_m: -6", "x_min_m: -3", "7: robots[0].start: (-4, 0) lies outside the area x -3…10, y -10…10 m"),
    ("y_m: -4}", "y_m: -14}", "12: robots[1].start: (1, -14) lies outside the area"),
    (
        "{x_m: 1, y_m: -4}",
        "{x_m: -4, y_m: 0.5}",
        "12: robots[1].start: the starts of robots '1' and 'b' are 0.5 m",
    ),
    (
        "{x_m: 1, y_m: 4, ",
        "{x_m: 3, y_m: 0, ",
        "13: robots[1].goal: the goals of robots '1' and 'b' are 1 m apart",
    ),
    # ambiguous or foreign YAML
    ("name: crossing", "name: a\nname: crossing", "2: 'name' is given twice, first in line 1: keep one"),
    ("y_m: -4}", "y_m: -4, x_m: 2}", "12: 'x_m' is given twice, first in line 12: keep one"),
    (
        "x_m: 4\n",
        "x_m: !!python/object:os.system {}\n",
        "9: the tag !!python/object:os.system is not allowed",
    ),
    ("x_m: 4\n", "x_m: !!python/name:os.system ''\n", "9: the tag !!python/name:os.system is not allowed"),
    ("x_m: 4\n", "x_m: !metres 4\n", "9: the tag !metres is not allowed"),
    ("x_m: 4\n", "x_m: !!python/tuple [4]\n", "9: the tag !!python/tuple is not allowed"),
    ("x_m: 4\n", "x_m: !!set {4}\n", "9: the tag !!set is not allowed"),
    ("x_m: 4\n", "x_m: !!binary NA==\n", "9: the tag !!binary is not allowed"),
    ("x_m: 4\n", "x_m: !!bool maybe\n", "9: 'maybe' cannot be read as !!bool"),
    ("x_m: 4\n", "x_m: 2026-13-45\n", "9: '2026-13-45' cannot be read as !!timestamp"),
    ("x_m: 4\n", f"x_m: {'9' * 5000}\n", "…' cannot be read as !!int"),
    ("x_m: 4\n", "? [x_m]\n      : 4\n", "9: a key must be text, found a map or a list"),
    ("x_m: 4\n", "<<: 4\n", "9: '<<' merges maps, found something else"),
    # text that is not YAML
    ("x_m: 4\n", "x_m: [4\n", "one YAML document is expected: while parsing a flow sequence"),
    ("      x_m: 4\n", "\tx_m: 4\n", "9: one YAML document is expected: while scanning for the next token"),
    ("x_m: 4\n", "x_m: *four\n", "9: one YAML document is expected: found undefined alias 'four'"),
    ("x_m: 4\n", "x_m: 4\x07\n", "9: the character U+0007 is not allowed"),
]


@pytest.mark.parametrize(
    ("old", "new", "told"), WRONG_FIELDS, ids=[f"{new:.30}" for _, new, _ in WRONG_FIELDS]
)
def test_one_mistake_is_told_in_one_line_with_its_place(load: Load, old: str, new: str, told: str) -> None:
    (line,) = refusal(load, changed(old, new))
    place, _, text = told.partition(": ")
    assert told in line
    assert line.startswith(f"crossing.yaml:{place}: {text}" if place.isdigit() else "crossing.yaml:")


WRONG_FILES = [
    (b"", "crossing.yaml: the file is empty; a scenario needs a map with name, robots …"),
    (b"# only a comment\n", "crossing.yaml: the file is empty; a scenario needs a map with name, robots …"),
    (b"null\n", "crossing.yaml:1: a map with name, robots … is expected, found nothing"),
    (b"\n- 1\n- 2\n", "crossing.yaml:2: a map with name, robots … is expected, found a list of 2"),
    (b"hello\n", "crossing.yaml:1: a map with name, robots … is expected, found 'hello'"),
    (
        b"name: a\nrobots: []\n",
        "crossing.yaml:2: robots: a list of at least 1 item is expected, found a list of 0",
    ),
    (b"name: a\nrobots: {}\n", "crossing.yaml:2: robots: a list is expected, found a map"),
    (
        b"name: a\nrobots: [" + b"1, " * 129 + b"]\n",
        "crossing.yaml:2: robots: a list of at most 128 items is expected, found a list of 129",
    ),
    (
        GOOD.encode() + b"---\nname: other\n",
        "crossing.yaml:17: one YAML document is expected: expected a single document in the stream, "
        "but found another document",
    ),
    (
        b"name: a\n# caf\xe9\n",
        "crossing.yaml:2: UTF-8 text is expected, found the byte 0xe9",
    ),
    (
        "name: a\n".encode("utf-16"),
        "crossing.yaml:1: UTF-8 text is expected, found the byte 0xff",
    ),
    (
        b"#" * (MAX_FILE_BYTES + 1),
        "crossing.yaml: the file is larger than 1048576 bytes, which is too much",
    ),
    (b"[" * 100_000, "crossing.yaml: nested too deep; a scenario has five levels at most"),
    (b"- " * 100_000, "crossing.yaml: nested too deep; a scenario has five levels at most"),
    (b"name: &a [*a]\n", "crossing.yaml: nested too deep; a scenario has five levels at most"),
]


@pytest.mark.parametrize(("content", "told"), WRONG_FILES, ids=[told[14:60] for _, told in WRONG_FILES])
def test_a_file_that_holds_no_scenario_is_refused(load: Load, content: bytes, told: str) -> None:
    assert refusal(load, content) == [told]


def test_the_largest_allowed_file_is_read(load: Load) -> None:
    assert load(GOOD.ljust(MAX_FILE_BYTES, "\n")).name == "crossing"


def test_a_missing_file_and_a_directory_are_told(tmp_path: Path) -> None:
    missing = tmp_path / "missing.yaml"
    with pytest.raises(Refusal, match="cannot be read: No such file") as raised:
        load_scenario(missing)
    assert str(raised.value).startswith(f"{missing}: ")
    with pytest.raises(Refusal, match="cannot be read: Is a directory"):
        load_scenario(tmp_path)


@pytest.mark.skipif(os.geteuid() == 0, reason="every file is readable by root")
def test_a_file_without_permission_is_told(tmp_path: Path) -> None:
    path = tmp_path / "secret.yaml"
    path.write_text(GOOD)
    path.chmod(0)
    with pytest.raises(Refusal, match="cannot be read: Permission denied"):
        load_scenario(path)


def test_several_mistakes_are_told_in_the_order_of_the_file(load: Load) -> None:
    wrong = GOOD.replace("y_m: 0\n", "y_m: zero\n").replace("speed_mps: 2", "speed_mps: -2")
    lines = refusal(load, wrong + "step_s: short\n")
    assert [line.split(": ")[:2] for line in lines] == [
        ["crossing.yaml:10", "robots[0].goal.y_m"],
        ["crossing.yaml:15", "robots[1].limits.speed_mps"],
        ["crossing.yaml:17", "step_s"],
    ]


@pytest.mark.parametrize(("mistakes", "rest"), [(5, []), (6, ["and 1 more"]), (8, ["and 3 more"])])
def test_at_most_five_mistakes_are_told_and_the_rest_counted(
    load: Load, mistakes: int, rest: list[str]
) -> None:
    lines = refusal(load, GOOD + "".join(f"key{n}: {n}\n" for n in range(mistakes)))
    assert [line.split(": ")[0] for line in lines[:5]] == [f"crossing.yaml:{n}" for n in range(17, 22)]
    assert lines[5:] == rest


def test_a_misspelt_key_does_not_hide_another_missing_one(load: Load) -> None:
    lines = refusal(
        load,
        changed("goal:\n      x_m: 4\n      y_m: 0\n", "gaol:\n      x_m: 4\n      y_m: 0\n").replace(
            "    start: {x_m: 1, y_m: -4}\n", ""
        ),
    )
    assert len(lines) == 2
    assert "'goal'?" in lines[0]
    assert lines[1] == "crossing.yaml:11: robots[1].start: this field is missing"


ALIASES = """\
name: aliases
robots:
  - {id: 1, start: {x_m: -4, y_m: 0}, goal: {x_m: 4, y_m: 0}, limits: &slow {speed_mps: 1, jerk_mps3: 2}}
  - {id: 2, start: {x_m: 0, y_m: -4}, goal: {x_m: 0, y_m: 4}, limits: *slow}
  - {id: 3, start: {x_m: 4, y_m: 4}, goal: {x_m: -4, y_m: -4}, limits: {speed_mps: 3, <<: *slow}}
  - {id: 4, start: {x_m: 4, y_m: -4}, goal: {x_m: -4, y_m: 4}, limits: {<<: [{speed_mps: 4}, *slow]}}
"""


def test_aliases_and_merge_keys_mean_what_yaml_says(load: Load) -> None:
    limits = [robot.limits for robot in load(ALIASES).robots]
    assert [limit.speed_mps for limit in limits] == [1, 1, 3, 4]
    assert [limit.jerk_mps3 for limit in limits] == [2, 2, 2, 2]


def test_a_mistake_behind_an_alias_is_told_where_it_is_written(load: Load) -> None:
    lines = refusal(load, ALIASES.replace("speed_mps: 1,", "speed_mps: fast,"))
    assert [line.partition(": ")[0] for line in lines] == ["crossing.yaml:3", "crossing.yaml:3"]
    assert "robots[1].limits.speed_mps" in lines[1]


def test_aliases_of_aliases_do_not_multiply(load: Load) -> None:
    bomb = "a0: &a0 [x]\n" + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 60))
    merges = "".join(f"b{n}: &b{n} {{<<: [{', '.join([f'*b{n - 1}'] * 9)}]}}\n" for n in range(1, 60))
    lines = refusal(load, f"{bomb}b0: &b0 {{x: 1}}\n{merges}name: *a59\n{GOOD.partition(chr(10))[2]}")
    assert lines[-1].startswith("and ")


TOKENS = st.sampled_from(
    [
        *GOOD.split(),
        "\n",
        "\n  ",
        " ",
        "- ",
        "{",
        "}",
        "[",
        "]",
        ": ",
        "&a ",
        "*a",
        "<<",
        "!!int ",
        "? ",
        "'",
        "#",
    ]
)


@given(st.one_of(st.text(), st.lists(TOKENS, max_size=40).map("".join), st.binary()))
def test_whatever_a_file_holds_there_is_no_other_exception(
    tmp_path_factory: pytest.TempPathFactory, content: str | bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "arbitrary.yaml"
    path.write_bytes(content.encode("utf-8", "surrogatepass") if isinstance(content, str) else content)
    with pytest.raises(Refusal, match=r"arbitrary\.yaml"):
        load_scenario(path)
