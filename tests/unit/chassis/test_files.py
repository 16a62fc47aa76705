"""Every way a file written by hand can be wrong is refused with lines and fields; scenarios stand for all."""

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chassis.files import MAX_FILE_BYTES
from chassis.refusal import ExitStatus, Refusal
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
X = "      x_m: 4\n"
GOAL_X = "9: robots[0].goal.x_m: "

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
    """The lines with which a file is refused, as of invalid usage."""
    with pytest.raises(Refusal) as raised:
        load(content)
    assert raised.value.status is ExitStatus.WRONG_USAGE
    return str(raised.value).splitlines()


# A change to the good file; the beginning of the one line that follows, and more that it says.
MISTAKES = [
    ("area: {", "aera: {", "2: aera: ", "no such field; did you mean 'area'?"),
    ("range_m: 5", "colour: 5", "16: robots[1].sensing.colour: ", "the fields here are range_m, position_"),
    ("  - id: b\n    start", "  - start", "11: robots[1].id: ", "this field is missing"),
    (X, "      x_m: 4e0\n", GOAL_X, "found '4e0'; to make it a number write it without quotes, and powers"),
    (X, "      x_m:\n", GOAL_X, "found nothing"),
    ("name: crossing", "name: 12", "1: name: ", "found 12; put it in quotes"),
    ("start: {x_m: -4, y_m: 0}", "start: -4", "7: robots[0].start: ", "a map with x_m, y_m … is expected"),
    ("id: b", "id: b/c", "11: robots[1].id: ", "'b/c' found, 1 to 32 letters, digits, '-' or '_'"),
    ("x_min_m: -6", "x_min_m: 10", "2: area: ", "the area is empty"),
    # ambiguous or foreign YAML, and text that is none
    ("name: crossing", "name: a\nname: crossing", "2: 'name' is given twice, first in line 1", "keep one"),
    (X, "      x_m: !!python/object:os.system {}\n", "9: the tag !!python/object:os.system is not", "plain"),
    (X, f"      x_m: {'9' * 5000}\n", "9: '9999", "…' cannot be read as !!int"),
    (X, "      ? [x_m]\n      : 4\n", "9: a key must be text, found a map or a list", ""),
    (X, "      <<: 4\n", "9: '<<' merges maps", ""),
    (X, "      x_m: [4\n", "10: one YAML document is expected: while parsing a flow sequence", ""),
    (X, "      x_m: 4\x07\n", "9: the character U+0007 is not allowed", ""),
]


@pytest.mark.parametrize(("old", "new", "begin", "rest"), MISTAKES, ids=[f"{m[1]:.30}" for m in MISTAKES])
def test_one_mistake_is_one_line_with_its_place(
    load: Load, old: str, new: str, begin: str, rest: str
) -> None:
    assert GOOD.count(old) == 1, old
    (line,) = refusal(load, GOOD.replace(old, new))
    assert line.startswith(f"crossing.yaml:{begin}")
    assert rest in line


@pytest.mark.parametrize(
    ("content", "begin"),
    [
        (b"# a comment\n", "crossing.yaml: the file is empty; a scenario needs a map with name, robots …"),
        (GOOD.encode() + b"---\nname: other\n", "crossing.yaml:17: one YAML document is expected: "),
        (b"name: a\n# caf\xe9\n", "crossing.yaml:2: UTF-8 text is expected, found the byte 0xe9"),
        (b"[" * 500, "crossing.yaml: nested too deep; a scenario has five levels at most"),
    ],
    ids=range(4),
)
def test_a_file_that_holds_no_scenario_is_refused(load: Load, content: bytes, begin: str) -> None:
    (line,) = refusal(load, content)
    assert line.startswith(begin)


def test_a_file_that_is_too_large_or_cannot_be_read_is_refused(load: Load) -> None:
    assert refusal(load, b" " * (MAX_FILE_BYTES + 1))[0].startswith("crossing.yaml: the file is larger than")
    for path, reason in (("missing.yaml", "No such file"), (".", "Is a directory")):
        with pytest.raises(Refusal, match=f"cannot be read: {reason}"):
            load_scenario(Path(path))


def test_five_mistakes_are_told_in_the_order_of_the_file_and_the_rest_counted(load: Load) -> None:
    wrong = GOOD.replace("y_m: 0\n", "y_m: zero\n").replace("speed_mps: 2", "speed_mps: -2")
    wrong = wrong.replace("    start: {x_m: 1,", "    strat: {x_m: 1,")
    wrong += "step_s: short\n" + "".join(f"key{n}: {n}\n" for n in range(4))
    assert [line.split(": ")[:2] for line in refusal(load, wrong)] == [
        ["crossing.yaml:10", "robots[0].goal.y_m"],
        ["crossing.yaml:12", "robots[1].strat"],  # and nothing of a start that is missing
        ["crossing.yaml:15", "robots[1].limits.speed_mps"],
        ["crossing.yaml:17", "step_s"],
        ["crossing.yaml:18", "key0"],
        ["and 3 more"],
    ]


ALIASES = """\
name: aliases
robots:
  - {id: 1, start: {x_m: -4, y_m: 0}, goal: {x_m: 4, y_m: 0}, limits: &slow {speed_mps: 1, jerk_mps3: 2}}
  - {id: 2, start: {x_m: 0, y_m: -4}, goal: {x_m: 0, y_m: 4}, limits: *slow}
  - {id: 3, start: {x_m: 4, y_m: 4}, goal: {x_m: -4, y_m: -4}, limits: {speed_mps: 3, <<: *slow}}
  - {id: 4, start: {x_m: 4, y_m: -4}, goal: {x_m: -4, y_m: 4}, limits: {<<: [{speed_mps: 4}, *slow, {}]}}
  - {id: 5, start: {x_m: 0, y_m: 4}, goal: {x_m: 0, y_m: -4}, limits: {<<: {}}}
"""


def test_aliases_and_merge_keys_mean_what_yaml_says_and_mistakes_are_told_where_they_are_written(
    load: Load,
) -> None:
    limits = [robot.limits for robot in load(ALIASES).robots]
    assert [limit.speed_mps for limit in limits] == [1, 1, 3, 4, 4.5]
    assert [limit.jerk_mps3 for limit in limits] == [2, 2, 2, 2, 7]
    lines = refusal(load, ALIASES.replace("speed_mps: 1,", "speed_mps: fast,"))
    assert [line.partition(": ")[0] for line in lines] == ["crossing.yaml:3", "crossing.yaml:3"]
    assert "robots[1].limits.speed_mps" in lines[1]


def test_aliases_of_aliases_do_not_multiply(load: Load) -> None:
    bomb = "a0: &a0 [x]\n" + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 60))
    merges = "".join(f"b{n}: &b{n} {{<<: [{', '.join([f'*b{n - 1}'] * 9)}]}}\n" for n in range(1, 60))
    lines = refusal(load, f"{bomb}b0: &b0 {{x: 1}}\n{merges}name: *a59\n{GOOD.partition(chr(10))[2]}")
    assert lines[-1].startswith("and ")


SIGNS = ["-", "{", "}", "[", "]", "&a", "*a", "?", "'", "#", "\n  ", ": ", "!!int ", "<<: *a"]
TOKENS = st.sampled_from([*GOOD.split(), *SIGNS])


@settings(max_examples=50)
@given(st.one_of(st.text(), st.lists(TOKENS, max_size=40).map("".join), st.binary()))
def test_whatever_a_file_holds_there_is_no_other_exception(
    tmp_path_factory: pytest.TempPathFactory, content: str | bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "arbitrary.yaml"
    path.write_bytes(content.encode("utf-8", "surrogatepass") if isinstance(content, str) else content)
    with pytest.raises(Refusal, match=r"arbitrary\.yaml"):
        load_scenario(path)
