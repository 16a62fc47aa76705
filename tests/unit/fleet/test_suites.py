"""Suites: made, written, read back, and the bundled one."""

import tomllib
from pathlib import Path

import pytest

from chassis.refusal import Refusal
from fleet.inject.scenario import Scenario, load_scenario
from fleet.scenarios.suite import generate, load_suite, write_suite
from scenarios import bundled_suites, find


def sizes(scenarios: dict[str, Scenario]) -> list[int]:
    return [len(scenario.robots) for scenario in scenarios.values()]


def test_numbers_of_robots_are_gone_through_in_turn() -> None:
    assert sizes(generate("perimeter", [2, 4, 8], 7, seed=0)) == [2, 4, 8, 2, 4, 8, 2]


def test_names_tell_family_robots_and_index_and_sort_as_numbers_do() -> None:
    made = generate("circle", [8, 12], 21, seed=0)
    assert list(made)[:3] == ["circle-08-01", "circle-12-01", "circle-08-02"]
    assert [made[name].name for name in made] == list(made)
    assert sizes({name: made[name] for name in sorted(made)}) == [8] * 11 + [12] * 10


def test_a_number_given_twice_counts_twice_and_loses_nothing() -> None:
    assert sizes(generate("perimeter", [4, 4, 8], 6, seed=0)) == [4, 4, 8, 4, 4, 8]


def test_scenarios_of_a_suite_differ_and_depend_on_the_seed_alone() -> None:
    def ways(seed: int, count: int) -> list[object]:
        return [scenario.robots for scenario in generate("perimeter", [4], count, seed).values()]

    assert ways(1, 6) == ways(1, 9)[:6]
    assert len({str(robots) for robots in ways(1, 20)}) == 20
    assert not [robots for robots in ways(1, 20) if robots in ways(2, 20)]


def test_a_suite_is_read_as_it_was_written_sorted_by_stem(tmp_path: Path) -> None:
    made = dict(zip(("b", "a-1", "a"), generate("heterogeneous", [3, 2], 3, seed=4).values(), strict=True))
    write_suite(tmp_path / "a" / "mine", made, "why")
    suite = load_suite(str(tmp_path / "a" / "mine"))
    assert suite.name == "mine"
    assert suite.scenarios == (("a", made["a"]), ("a-1", made["a-1"]), ("b", made["b"]))
    assert (tmp_path / "a" / "mine" / "b.yaml").read_text().startswith("# why\nname: het")


def test_the_directory_where_one_stands_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_suite(tmp_path / "mine", generate("circle", [2], 1, seed=0), "why")
    monkeypatch.chdir(tmp_path / "mine")
    assert load_suite(".").name == "mine"


def test_an_empty_directory_takes_a_suite_and_nothing_else_is_left_beside_it(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    write_suite(tmp_path / "mine", generate("circle", [2], 3, seed=0), "why")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    assert len(load_suite(str(tmp_path / "mine")).scenarios) == 3


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_nothing_is_left_when_writing_fails_halfway(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
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
        write_suite(tmp_path / "mine", generate("circle", [2], 3, seed=0), "why")
    assert len(written) == 2
    assert list(tmp_path.iterdir()) == []


def test_a_directory_that_is_filled_meanwhile_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = Path.write_text

    def disturbed(path: Path, text: str, **options: str) -> int:
        (tmp_path / "mine").mkdir(exist_ok=True)
        (tmp_path / "mine" / "thesis.tex").touch()
        return whole(path, text, **options)

    monkeypatch.setattr(Path, "write_text", disturbed)
    with pytest.raises(Refusal, match="mine cannot be used for the output: Directory not empty"):
        write_suite(tmp_path / "mine", generate("circle", [2], 3, seed=0), "why")
    assert [str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")] == ["mine", "mine/thesis.tex"]


@pytest.mark.parametrize("name", ["8a", str(find("8a"))])
def test_a_single_scenario_is_a_suite_of_one(name: str) -> None:
    suite = load_suite(name)
    assert (suite.name, suite.scenarios) == ("8a", (("8a", load_scenario(find("8a"))),))


def test_an_unknown_suite_is_told_with_the_known_ones_and_the_nearest() -> None:
    with pytest.raises(Refusal) as raised:
        load_suite("fourty")
    assert str(raised.value) == (
        "fourty: there is no such file or directory and no bundled suite or scenario of this name; "
        "the bundled ones are forty, 2-crossing, 3-crossing, 4-crossing, 8a; did you mean 'forty'?"
    )


def test_a_directory_without_scenario_files_is_told(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    with pytest.raises(Refusal, match=r"at least one scenario file, and no \*\.yaml is there") as raised:
        load_suite(str(tmp_path))
    assert str(raised.value).startswith(f"{tmp_path}: ")


def test_every_bad_file_of_a_suite_is_told(tmp_path: Path) -> None:
    write_suite(tmp_path / "mine", generate("circle", [2], 3, seed=0), "why")
    for stem in ("bad", "worse"):
        (tmp_path / "mine" / f"{stem}.yaml").write_text("name: a\n")
    (tmp_path / "mine" / "directory.yaml").mkdir()
    with pytest.raises(Refusal) as raised:
        load_suite(str(tmp_path / "mine"))
    bad, directory, worse = str(raised.value).splitlines()
    assert bad.endswith("mine/bad.yaml:1: robots: this field is missing")
    assert directory.endswith("mine/directory.yaml: the file cannot be read: Is a directory")
    assert worse.endswith("mine/worse.yaml:1: robots: this field is missing")


def test_the_bundled_suites_are_these() -> None:
    assert list(bundled_suites()) == ["forty"]


def test_forty_is_the_perimeter_family_with_8a_for_the_first_of_eight_robots() -> None:
    made = generate("perimeter", range(2, 9), 40, seed=2026)
    del made["perimeter-8-01"]
    made["8a"] = load_scenario(find("8a"))
    suite = load_suite("forty")
    assert suite.name == "forty"
    assert suite.scenarios == tuple(sorted(made.items()))
    assert [sizes(made).count(robots) for robots in range(2, 9)] == [6, 6, 6, 6, 6, 5, 5]
    assert len({str(scenario.robots) for scenario in made.values()}) == 40


def test_the_installed_package_holds_every_bundled_file() -> None:
    root = Path(__file__).parents[3]
    tool = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]
    assert tool["package-data"]["*"] == ["*.yaml"]
    folders = {path.parent.relative_to(root) for path in (root / "scenarios").rglob("*.yaml")}
    assert {".".join(folder.parts) for folder in folders} <= set(tool["packages"])
