"""``unspoken scenarios``."""

from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from fleet.cli import app
from fleet.scenarios.families import FAMILIES
from fleet.scenarios.suite import load_suite


@pytest.fixture(autouse=True)
def _in_an_empty_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("COLUMNS", "TERMINAL_WIDTH"):
        monkeypatch.setenv(name, "200")


def scenarios(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["scenarios", *map(str, arguments)])


def sizes(directory: str) -> list[int]:
    return [len(scenario.robots) for _, scenario in load_suite(directory).scenarios]


def test_bundled_scenarios_and_suites_are_listed_with_their_robots() -> None:
    result = scenarios("list")
    assert result.exit_code == 0
    rows = [line.split() for line in result.stdout.splitlines()]
    assert ["8a", "1", "8"] in rows
    assert ["2-crossing", "1", "2"] in rows
    assert ["forty", "40", "2–8"] in rows


def test_a_suite_is_generated_and_told_in_one_line() -> None:
    result = scenarios("generate", "--robots", "2..8", "--count", 9, "--seed", 3, "--out", "new/mine")
    assert result.exit_code == 0
    assert result.stdout == "Wrote 9 scenarios of 2–8 robots to new/mine.\n"
    assert sizes("new/mine") == [2, 2, 3, 3, 4, 5, 6, 7, 8]


@pytest.mark.parametrize("family", FAMILIES)
def test_the_first_line_of_a_file_is_the_command_that_makes_it_again(family: str) -> None:
    options = ("--family", family, "--robots", "3,5..6", "--count", 4, "--seed", 7)
    assert scenarios("generate", *options, "--out", "one").exit_code == 0
    assert Path(f"one/{family}-3-1.yaml").exists()
    (first,) = {path.read_text().splitlines()[0] for path in Path("one").iterdir()}
    command = first.removeprefix("# Made by unspoken scenarios ")
    assert scenarios(*command.split(), "--out", "other").exit_code == 0
    for path in Path("one").iterdir():
        assert path.read_bytes() == (Path("other") / path.name).read_bytes()
    assert sizes("other") == [3, 3, 5, 6]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), ("--out",)),
        (("--out", "mine", "--family", "spiral"), ("--family", "spiral", "perimeter", "heterogeneous")),
        (("--out", "mine", "--count", "0"), ("--count",)),
        (("--out", "mine", "--seed", "-1"), ("--seed",)),
        (("--out", "mine", "--robots", "17"), ("has room for 16 robots, not for 17",)),
        *(
            (
                ("--out", "mine", f"--robots={wrong}"),
                ("--robots", f"'{wrong}' found", "such as 4, 2,4,8 or 2..8"),
            )
            for wrong in (
                "",
                "0",
                "129",
                "8..2",
                "2...8",
                "2..",
                "..8",
                "2,,8",
                "2-8",
                "four",
                "2.5",
                "1 2",
                "²",
            )
        ),
    ],
)
def test_wrong_usage_is_refused_and_nothing_is_written(
    options: tuple[str, ...], words: tuple[str, ...]
) -> None:
    result = scenarios("generate", *options)
    assert result.exit_code == 2
    for word in words:
        assert word in result.stderr
    assert "Traceback" not in result.output
    assert result.stdout == ""
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize(
    ("out", "told"),
    [
        ("mine", "mine is not empty; choose another directory with --out, or remove it"),
        ("mine/thesis.tex/suite", "thesis.tex/suite cannot be used for the output: Not a directory"),
        ("/", "/ is not empty"),
        (".", "is where you are"),
    ],
)
def test_a_directory_that_cannot_be_used_is_refused_and_left_as_it_was(out: str, told: str) -> None:
    Path("mine").mkdir()
    Path("mine/thesis.tex").write_text("of great value")
    result = scenarios("generate", "--out", out)
    assert result.exit_code == 2
    assert told in result.stderr
    assert [str(path) for path in sorted(Path().rglob("*"))] == ["mine", "mine/thesis.tex"]


@pytest.mark.parametrize("command", ["list", "generate"])
def test_every_command_has_a_help_with_its_exit_status(command: str) -> None:
    result = scenarios(command, "--help")
    assert result.exit_code == 0
    assert "Exit status: 0" in result.stdout
