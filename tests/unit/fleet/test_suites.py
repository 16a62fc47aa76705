"""Suites: made, written, read back, and the bundled one; ``unspoken scenarios``."""

import tomllib
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from chassis.refusal import Refusal
from fleet.cli import app
from fleet.inject.scenario import Scenario, load_scenario
from fleet.scenarios.suite import generate, load_suite, write_suite
from scenarios import find


@pytest.fixture(autouse=True)
def _in_an_empty_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("COLUMNS", "TERMINAL_WIDTH"):
        monkeypatch.setenv(name, "200")


def scenarios(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["scenarios", *map(str, arguments)])


def sizes(scenarios: dict[str, Scenario]) -> list[int]:
    return [len(scenario.robots) for scenario in scenarios.values()]


def test_numbers_of_robots_are_gone_through_in_turn_and_names_sort_as_numbers_do() -> None:
    assert sizes(generate("perimeter", [4, 4, 8], 7, seed=0)) == [4, 4, 8, 4, 4, 8, 4]
    made = generate("circle", [8, 12], 21, seed=0)
    assert list(made)[:3] == ["circle-08-01", "circle-12-01", "circle-08-02"]
    assert [made[name].name for name in made] == list(made)
    assert sizes({name: made[name] for name in sorted(made)}) == [8] * 11 + [12] * 10


def test_scenarios_of_a_suite_differ_and_depend_on_the_seed_alone() -> None:
    def ways(seed: int, count: int) -> list[object]:
        return [scenario.robots for scenario in generate("perimeter", [4], count, seed).values()]

    assert ways(1, 6) == ways(1, 9)[:6]
    assert len({str(robots) for robots in ways(1, 20)}) == 20
    assert not [robots for robots in ways(1, 20) if robots in ways(2, 20)]


def test_a_suite_is_read_as_it_was_written_sorted_by_stem(monkeypatch: pytest.MonkeyPatch) -> None:
    made = dict(zip(("b", "a-1", "a"), generate("heterogeneous", [3, 2], 3, seed=4).values(), strict=True))
    Path("a/mine").mkdir(parents=True)
    write_suite(Path("a/mine"), made, "why")
    suite = load_suite("a/mine")
    assert suite.name == "mine"
    assert list(suite.scenarios.items()) == sorted(made.items())
    assert Path("a/mine/b.yaml").read_text().startswith("# why\nname: het")
    assert [path.name for path in Path("a").iterdir()] == ["mine"]
    monkeypatch.chdir("a/mine")
    assert load_suite(".") == suite


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_nothing_is_left_when_writing_fails_halfway(
    monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    written: list[Path] = []
    whole = Path.write_text

    def failing(path: Path, text: str, **options: str) -> int:
        if len(written) == 2:
            raise error
        written.append(path)
        return whole(path, text, **options)

    monkeypatch.setattr(Path, "write_text", failing)
    expected = Refusal if isinstance(error, OSError) else type(error)
    with pytest.raises(expected):
        write_suite(Path("mine"), generate("circle", [2], 3, seed=0), "why")
    assert len(written) == 2
    assert list(Path().iterdir()) == []


def test_a_directory_that_is_filled_meanwhile_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Path.write_text

    def disturbed(path: Path, text: str, **options: str) -> int:
        Path("mine").mkdir(exist_ok=True)
        Path("mine/thesis.tex").touch()
        return whole(path, text, **options)

    monkeypatch.setattr(Path, "write_text", disturbed)
    with pytest.raises(Refusal, match="mine cannot be used for the output: Directory not empty"):
        write_suite(Path("mine"), generate("circle", [2], 3, seed=0), "why")
    assert sorted(map(str, Path().rglob("*"))) == ["mine", "mine/thesis.tex"]


@pytest.mark.parametrize("name", ["8a", str(find("8a"))])
def test_a_single_scenario_is_a_suite_of_one(name: str) -> None:
    assert load_suite(name) == ("8a", {"8a": load_scenario(find("8a"))})


def test_what_is_no_suite_is_told_with_the_reason_for_each_file() -> None:
    with pytest.raises(Refusal, match=r"the bundled ones are forty, 2-crossing, .*; did you mean 'forty'\?"):
        load_suite("fourty")
    Path("mine").mkdir()
    with pytest.raises(Refusal, match=r"^mine: .* at least one scenario file, and no \*\.yaml is there"):
        load_suite("mine")
    for stem in ("bad", "worse"):
        Path(f"mine/{stem}.yaml").write_text("name: a\n")
    Path("mine/directory.yaml").mkdir()
    with pytest.raises(Refusal) as raised:
        load_suite("mine")
    bad, directory, worse = str(raised.value).splitlines()
    assert bad.endswith("mine/bad.yaml:1: robots: this field is missing")
    assert directory.endswith("mine/directory.yaml: the file cannot be read: Is a directory")
    assert worse.endswith("mine/worse.yaml:1: robots: this field is missing")


def test_forty_is_the_perimeter_family_with_8a_for_the_first_of_eight_robots() -> None:
    made = generate("perimeter", range(2, 9), 40, seed=2026)
    del made["perimeter-8-01"]
    made["8a"] = load_scenario(find("8a"))
    suite = load_suite("forty")
    assert suite.name == "forty"
    assert list(suite.scenarios.items()) == sorted(made.items())
    assert [sizes(made).count(robots) for robots in range(2, 9)] == [6, 6, 6, 6, 6, 5, 5]
    assert len({str(scenario.robots) for scenario in made.values()}) == 40


def test_the_installed_package_holds_every_bundled_file() -> None:
    root = Path(__file__).parents[3]
    tool = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]
    assert tool["package-data"]["*"] == ["*.yaml"]
    folders = {path.parent.relative_to(root) for path in (root / "scenarios").rglob("*.yaml")}
    assert {".".join(folder.parts) for folder in folders} <= set(tool["packages"])


def test_bundled_scenarios_and_suites_are_listed_with_their_robots() -> None:
    result = scenarios("list")
    assert result.exit_code == 0
    rows = [line.split() for line in result.stdout.splitlines()]
    assert ["8a", "1", "8"] in rows
    assert ["forty", "40", "2–8"] in rows


def test_the_first_line_of_a_generated_file_is_the_command_that_makes_it_again() -> None:
    options = ("--family", "corridor", "--robots", "3,5..6", "--count", 4, "--seed", 7)
    result = scenarios("generate", *options, "--out", "new/one")
    assert result.stdout == "Wrote 4 scenarios of 3–6 robots to new/one.\n"
    (first,) = {path.read_text().splitlines()[0] for path in Path("new/one").iterdir()}
    command = first.removeprefix("# Made by unspoken scenarios ")
    assert scenarios(*command.split(), "--out", "other").exit_code == 0
    for path in Path("new/one").iterdir():
        assert path.read_bytes() == (Path("other") / path.name).read_bytes()
    assert sizes(load_suite("other").scenarios) == [3, 3, 5, 6]


WRONG_NUMBERS = ("", "0", "129", "8..2", "2...8", "2..", "..8", "2,,8", "2-8", "four", "2.5", "1 2", "²")


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ((), "--out"),
        (("--out", "mine", "--family", "spiral"), "spiral"),
        (("--out", "mine", "--count", "0"), "--count"),
        (("--out", "mine", "--seed", "-1"), "--seed"),
        (("--out", "mine", "--robots", "17"), "has room for 16 robots, not for 17"),
        *((("--out", "mine", f"--robots={wrong}"), f"'{wrong}' found") for wrong in WRONG_NUMBERS),
    ],
)
def test_wrong_usage_is_refused_and_nothing_is_written(options: tuple[str, ...], told: str) -> None:
    result = scenarios("generate", *options)
    assert result.exit_code == 2
    assert told in result.stderr
    assert "Traceback" not in result.output
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize(
    ("out", "told"),
    [
        ("mine", "mine is not empty; choose another directory with --out, or remove it"),
        ("mine/thesis.tex/suite", "thesis.tex/suite cannot be used for the output: Not a directory"),
        (".", "is where you are"),
    ],
)
def test_a_directory_that_cannot_be_used_is_refused_and_left_as_it_was(out: str, told: str) -> None:
    Path("mine").mkdir()
    Path("mine/thesis.tex").write_text("of great value")
    result = scenarios("generate", "--out", out)
    assert result.exit_code == 2
    assert told in result.stderr
    assert sorted(map(str, Path().rglob("*"))) == ["mine", "mine/thesis.tex"]
