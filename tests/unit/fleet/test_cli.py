"""The command line, in this process; tests/processes has runs in processes of their own."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from click.testing import Result
from typer.testing import CliRunner

import world.__main__
from agent.solve import Deadline, SolverName, joint_solver
from agent.solve.problem import JointSolver
from chassis.refusal import app_of
from fleet.cli import COMMANDS, app
from fleet.record.recording import read_recording

GROUPS = ("bridge", "keys", "scenarios")
SUBCOMMANDS = ("bridge ros2", "keys create", "keys show", "scenarios list", "scenarios generate")
HEAD_ON = [
    {"id": 1, "start": {"x_m": -1.5, "y_m": 0.0}, "goal": {"x_m": 1.5, "y_m": 0.0}},
    {"id": 2, "start": {"x_m": 1.5, "y_m": 0.0}, "goal": {"x_m": -1.5, "y_m": 0.0}},
]
ALONE = [{"id": "solo", "start": {"x_m": 0.0, "y_m": 0.0}, "goal": {"x_m": 0.5, "y_m": 0.0}}]


@pytest.fixture(autouse=True)
def _in_an_empty_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")


def unspoken(*arguments: object, env: dict[str, str] | None = None) -> Result:
    return CliRunner().invoke(app, list(map(str, arguments)), env=env, prog_name="unspoken")


def scenario(robots: list[dict[str, Any]], **rules: Any) -> str:
    """A scenario file in the present directory; its robots look as far ahead as they brake."""
    horizons = {"prediction_steps": 20, "estimation_steps": 3}
    content = {"name": "test", "robots": robots, "horizons": horizons, **rules}
    Path("test.yaml").write_text(yaml.safe_dump(content))
    return "test.yaml"


def summary_in(directory: Path | str) -> dict[str, Any]:
    summary: dict[str, Any] = json.loads((Path(directory) / "summary.json").read_text())
    return summary


def is_refused(result: Result, *words: str) -> None:
    """Check that it ended with invalid usage, in words, without a traceback and without a trace."""
    assert result.exit_code == 2
    assert "Traceback" not in result.output
    for word in words:
        assert word in result.stderr
    assert result.stdout == ""
    assert not Path("runs").exists()


@pytest.mark.parametrize("command", [*COMMANDS, *SUBCOMMANDS])
def test_every_command_has_a_help_with_its_exit_status_that_fits_the_terminal(command: str) -> None:
    result = unspoken(*command.split(), "--help", env={"COLUMNS": "80"})
    assert result.exit_code == 0
    assert result.stdout.startswith(f"Usage: unspoken {command} ")
    assert command in GROUPS or "Exit status: 0" in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 80


def test_the_command_alone_lists_all_commands_each_in_one_whole_line() -> None:
    result = unspoken(env={"COLUMNS": "80"})
    for command, (_, line) in COMMANDS.items():
        assert re.search(rf"^  {command} +{re.escape(line)}$", result.output, re.MULTILINE)


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("sim", {"simulate"}),
        ("run --it", {"--iterations"}),
        ("run --solver re", {"realtime", "reference"}),
        ("keys cr", {"create"}),
        ("agent --budg", {"--budget-ms"}),
    ],
)
def test_the_shell_completes_commands_options_and_values(words: str, found: set[str]) -> None:
    line = f"unspoken {words}"
    wanted = {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split()) - 1)}
    result = CliRunner().invoke(
        app, [], prog_name="unspoken", env={"_UNSPOKEN_COMPLETE": "complete_bash", **wanted}
    )
    assert set(result.stdout.split()) == found


def test_every_option_of_a_world_has_its_environment_variable() -> None:
    options = typer.main.get_command(app_of(world.__main__.main)).params
    assert len(options) >= 13
    for option in options:
        assert option.envvar == f"UNSPOKEN_{option.name.upper()}"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("run", ("SCENARIO",)),
        ("run 8b", ("8b", "2-crossing, 3-crossing, 4-crossing, 8a", "did you mean '8a'?")),
        ("simulate 8b", ("did you mean '8a'?",)),
        ("run 8a --goals guess", ("--goals", "guess", "exchanged", "ioc", "constant-acceleration")),
        ("simulate 8a --clock slow", ("--clock", "slow", "lockstep", "realtime")),
        ("run 8a --solver slow", ("--solver", "slow", "realtime", "reference")),
        ("run 8a --iterations 0", ("--iterations", "greater than or equal to 1")),
        ("simulate 8a --iterations 2.5", ("--iterations", "integer")),
        ("run 8a --seed -1", ("--seed", "greater than or equal to 0")),
        ("simulate 8a --speed 3", ("--speed",)),
        ("run 8a --budget-ms nan", ("--budget-ms", "or equal to 0")),
        ("run 8a --budget-ms inf", ("--budget-ms", "finite")),
        ("run 8a --budget-ms -0.1", ("--budget-ms", "0")),
        ("simulate 8a --budget-ms 50", ("--budget-ms",)),  # it has no clock that could bound decisions
    ],
)
def test_wrong_usage_is_refused_before_anything_is_written(arguments: str, words: tuple[str, ...]) -> None:
    is_refused(unspoken(*arguments.split()), *words)


def test_a_simulation_keeps_which_solver_it_used_and_how(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[str, int]] = []
    original = joint_solver

    def noted(name: SolverName, iterations: int, deadline: Deadline) -> JointSolver:
        given.append((name, iterations))
        return original(name, iterations, deadline)

    monkeypatch.setattr("agent.process.options.joint_solver", noted)
    path = scenario(ALONE, time_limit_s=0.1)
    unspoken("simulate", path, "--iterations", 5, "--no-reserve", "--out", "out")
    assert given[-1] == ("realtime", 5)
    facts = read_recording(Path("out/run.mcap")).facts
    assert (facts.solver, facts.iterations, facts.budget_ms, facts.reserve) == ("realtime", 5, None, False)


@pytest.mark.parametrize("command", ["run", "simulate"])
def test_where_the_solver_cannot_be_compiled_the_run_fails_and_says_why(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("file").touch()
    monkeypatch.setattr("agent.solve.compiled.FOLDER", Path("nowhere"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(Path("file/cache").absolute()))
    result = unspoken(command, scenario(ALONE), "--out", "out")
    assert result.exit_code == 3
    assert re.fullmatch(r".*file/cache cannot be written; set NUMBA_CACHE_DIR .*\n", result.stderr)
    assert summary_in("out")["verdict"] == "failed"


@pytest.mark.parametrize("command", ["run", "simulate"])
def test_a_wrong_scenario_or_directory_is_one_clear_message_and_nothing_is_touched(command: str) -> None:
    path = scenario([{**ALONE[0], "gaol": {"x_m": 1.0, "y_m": 0.0}}])
    result = unspoken(command, path)
    is_refused(result, "test.yaml", "gaol", "goal")
    assert len(result.stderr.splitlines()) == 1
    Path("mine").mkdir()
    Path("mine/thesis.tex").write_text("of great value")
    is_refused(unspoken(command, "2-crossing", "--out", "mine"), "mine is not empty", "--out")
    assert Path("mine/thesis.tex").read_text() == "of great value"
    out = "mine/thesis.tex/run"
    is_refused(unspoken(command, "2-crossing", "--out", out), f"{out} cannot be used for the output")
    is_refused(unspoken(command, "2-crossing", "--out", "mine/thesis.tex"), "--out", "file")


def test_one_robot_alone_arrives_and_without_out_the_output_goes_to_a_new_directory_under_runs() -> None:
    result = unspoken("simulate", scenario(ALONE, name="north/../hall 1"), "--goals", "exchanged")
    assert (result.exit_code, result.stderr) == (0, "")
    [directory] = Path("runs").iterdir()
    assert re.fullmatch(r"north-..-hall-1-exchanged-\d{8}-\d{6}", directory.name)
    assert f"Recorded in {directory}:" in result.stdout
    summary = summary_in(directory)
    assert (summary["scenario"], summary["verdict"], summary["clock"]) == (
        "north/../hall 1",
        "arrived",
        "virtual",
    )
    assert summary["robots"][0]["arrived_s"] == summary["duration_s"]
    assert f"The robot arrived after {summary['duration_s']:.1f} s." in result.stdout


def test_the_seed_is_kept_and_the_clock_of_a_simulation_changes_nothing() -> None:
    path = scenario(ALONE, time_limit_s=0.3, sensing={"position_noise_m": 0.01})
    long = "a" * 120
    for name, options in {"one": (), long: ("--clock", "realtime")}.items():
        result = unspoken("simulate", path, "--seed", 9, "--out", name, *options, env={"COLUMNS": "80"})
        assert result.exit_code == 1
        assert f"Recorded in {name}: paths.png, run.mcap, summary.json" in result.stdout.splitlines()
    one, other = summary_in("one"), summary_in(long)
    assert one["seed"] == 9
    for summary in (one, other):
        del summary["phases_ms"]
    assert one == other


PARKED = {"id": 1, "start": {"x_m": 2.0, "y_m": 0.0}, "goal": {"x_m": 2.0, "y_m": 0.0, "heading_rad": 0.0}}
BEHIND = {"id": 2, "start": {"x_m": 0.5, "y_m": 0.0}, "goal": {"x_m": 4.0, "y_m": 0.0}}
LANE = {"y_min_m": -0.1, "y_max_m": 0.1}


@pytest.mark.parametrize(
    ("robots", "rules", "verdict", "line"),
    [
        (
            HEAD_ON,
            {"time_limit_s": 0.3},
            "timeout",
            "Out of time after 0.3 s: robots 1 and 2 had not arrived",
        ),
        (HEAD_ON, {"sensing": {"dropout": 1.0}}, "collision", "Collision of 1 pair of robots; after"),
        ([PARKED, BEHIND], {"area": LANE}, "deadlock", "robot 2 never arrived"),
    ],
)
def test_a_run_in_which_not_all_arrive_well_says_so(
    robots: list[dict[str, Any]], rules: dict[str, Any], verdict: str, line: str
) -> None:
    """Robots that do not see each other collide; one behind a parked one in a lane ends in a deadlock."""
    result = unspoken("simulate", scenario(robots, **rules), "--goals", "exchanged", "--out", "out")
    assert (result.exit_code, result.stderr) == (1, "")
    assert line in " ".join(result.stdout.split())
    summary = summary_in("out")
    assert (summary["verdict"], summary["collisions"]) == (verdict, verdict == "collision")
