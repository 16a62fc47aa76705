"""Runs with faults from the command line, and what is kept of them."""

from pathlib import Path

import pytest
import yaml
from auditing_helpers import experiment_of, simulated
from click.testing import Result
from faults_helpers import MEETING
from typer.testing import CliRunner

import protocol.scenario
from fleet.cli import app
from fleet.record.recording import Recording, read_recording
from protocol.messages import Command, PublicScene, Truth

LOSSY = [{"kind": "loss", "rate": 1.0, "robots": [1], "start_s": 0.1}]


@pytest.fixture(autouse=True)
def _in_an_empty_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    content = {"name": "short", "time_limit_s": 0.6, "robots": MEETING}
    (tmp_path / "short.yaml").write_text("# a comment\n" + yaml.safe_dump(content))
    (tmp_path / "faults.yaml").write_text(yaml.safe_dump({"faults": LOSSY}))


def unspoken(*arguments: object) -> Result:
    return CliRunner().invoke(app, list(map(str, arguments)))


def simulated_with(*options: object) -> tuple[Recording, list[int]]:
    """The recording, and how many steps each robot missed."""
    assert unspoken("simulate", "short.yaml", *options, "--out", "out").exit_code == 1, "it ends by time"
    recording = read_recording(Path("out", "run.mcap"))
    truths = [message for _, message in recording if isinstance(message, Truth)]
    return recording, [robot.deadline_misses for robot in truths[-1].robots.values()]


def test_a_recording_holds_the_scenario_with_the_faults_of_the_file_and_is_not_repeated() -> None:
    recording, missed = simulated_with("--faults", "faults.yaml")
    assert protocol.scenario.load_scenario(recording.path, recording.scenario_text).faults == tuple(LOSSY)
    assert (recording.facts.faults, missed) == (1, [5, 0])
    for command in (("audit",), ("replay", "--robot", "1")):
        result = unspoken(*command, "out")
        assert result.exit_code == 2
        assert result.stderr.count("\n") == 1
        assert "a fault was part of this run" in result.stderr


def test_without_a_file_the_scenario_is_kept_as_it_was_written() -> None:
    recording, missed = simulated_with()
    assert recording.scenario_text == Path("short.yaml").read_text()
    assert (recording.facts.faults, missed) == (0, [0, 0])


def test_the_faults_of_a_scenario_befall_it_and_count_too() -> None:
    with Path("short.yaml").open("a") as file:
        file.write("faults: [{kind: command-loss, rate: 1, robots: [2]}]\n")
    recording, missed = simulated_with("--faults", "faults.yaml")
    assert (recording.facts.faults, missed) == (2, [5, 6])
    commands = [message for key, message in recording if key.endswith("command/2")]
    assert [command.withheld for command in commands if isinstance(command, Command)] == [True] * 6


def test_each_epoch_of_a_restarted_world_begins_with_its_scene_and_time_goes_on(tmp_path: Path) -> None:
    experiment = experiment_of(tmp_path, faults=[{"kind": "restart-world", "start_s": 0.3}])
    messages = simulated(experiment)
    scenes = [index for index, each in enumerate(messages) if isinstance(each.message, PublicScene)]
    assert [messages[index].message.epoch for index in scenes] == [0, 1]
    times_ns = [each.time_ns for each in messages]
    assert times_ns == sorted(times_ns)
    assert [each.message.epoch for each in messages] == [0] * scenes[1] + [1] * (len(messages) - scenes[1])


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, "faults.yaml: the file cannot be read: No such file or directory"),
        ("faults: [{kind: los}]", "faults.yaml:1: faults[0].kind: there is no kind 'los'"),
    ],
)
def test_a_wrong_file_is_told_in_a_line_and_nothing_is_run(content: str | None, told: str) -> None:
    Path("faults.yaml").unlink()
    if content is not None:
        Path("faults.yaml").write_text(content)
    result = unspoken("simulate", "short.yaml", "--faults", "faults.yaml", "--out", "out")
    assert result.exit_code == 2
    assert result.stderr.startswith(told)
    assert result.stderr.count("\n") == 1
    assert not Path("out").exists()
