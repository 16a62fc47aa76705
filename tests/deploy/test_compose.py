"""compose.yaml as Compose itself reads it, against the scenario that it runs."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer

import agent.__main__
import world.__main__
from agent.__main__ import parse_goal
from protocol.scenario_file import load_scenario
from scenarios import find

ROOT = Path(__file__).parents[2]
COMPOSE = Path(sys.executable).parent / "docker-compose"
"""From compose-tool.txt: one version everywhere, whatever the machine has."""


def compose_config(file, *options):
    """What Compose says to a file, without a container engine and without the machine's own settings."""
    return subprocess.run(
        [COMPOSE, "--file", file, "--env-file", "/dev/null", "config", *options],
        env={},
        capture_output=True,
        text=True,
    )


def environment_variables(main):
    """Names of the environment variables that a command line reads; True for those it cannot do without."""
    app = typer.Typer()
    app.command()(main)
    return {option.envvar: option.required for option in typer.main.get_command(app).params if option.envvar}


@pytest.fixture(scope="module")
def config():
    """compose.yaml with anchors, merges and defaults resolved."""
    read = compose_config(ROOT / "compose.yaml", "--format", "json")
    assert read.returncode == 0, read.stderr
    return json.loads(read.stdout)


@pytest.fixture(scope="module")
def robots(config):
    """The services of the robots by name."""
    return {name: service for name, service in config["services"].items() if name != "world"}


@pytest.fixture(scope="module")
def scenario(config):
    return load_scenario(find(config["services"]["world"]["environment"]["UNSPOKEN_SCENARIO"]))


def test_compose_accepts_the_file():
    checked = compose_config(ROOT / "compose.yaml", "--quiet")
    assert (checked.returncode, checked.stdout, checked.stderr) == (0, "", "")


@pytest.mark.parametrize(
    ("right", "wrong", "complaint"),
    [
        ("networks: [robot-3]", "networks: [robot-9]", "undefined network"),
        ("depends_on: [world]", "depends_on: [wrold]", "undefined service"),
        ("  world:\n", "  world:\n    depends_on: [robot-1]\n", "cycle"),
        ("read_only: true", "read_onyl: true", "read_onyl"),
        ("context: .", "context: ${NOWHERE:?it is not set}", "NOWHERE"),
    ],
)
def test_compose_refuses_a_broken_copy(tmp_path, right, wrong, complaint):
    text = (ROOT / "compose.yaml").read_text()
    assert right in text
    broken = tmp_path / "compose.yaml"
    broken.write_text(text.replace(right, wrong, 1))
    checked = compose_config(broken, "--quiet")
    assert checked.returncode != 0
    assert complaint in checked.stderr


def test_the_scenario_is_8a(scenario):
    assert scenario == load_scenario(ROOT / "scenarios" / "8a.yaml")


def test_every_robot_of_the_scenario_has_one_service_with_its_goal(robots, scenario):
    told = [
        (service["environment"]["UNSPOKEN_ROBOT"], parse_goal(service["environment"]["UNSPOKEN_GOAL"]))
        for service in robots.values()
    ]
    assert sorted(told, key=lambda pair: pair[0]) == [
        (robot.id, robot.goal_pose()) for robot in scenario.robots
    ]


def test_robots_estimate_goals_which_the_world_keeps_to_itself(config, robots):
    assert {service["environment"]["UNSPOKEN_GOALS"] for service in robots.values()} == {"ioc"}
    assert "UNSPOKEN_EXCHANGE_GOALS" not in config["services"]["world"]["environment"]


def test_each_process_is_told_what_it_needs_and_nothing_that_it_does_not_know(config):
    for name, service in config["services"].items():
        known = environment_variables(world.__main__.main if name == "world" else agent.__main__.main)
        told = set(service["environment"])
        assert told <= set(known), name
        assert {variable for variable, required in known.items() if required} <= told, name


def test_robots_connect_to_the_world_in_the_same_run(config, robots):
    told = config["services"]["world"]["environment"]
    assert told["UNSPOKEN_LISTEN"] == "tcp/0.0.0.0:7447"
    for service in robots.values():
        assert service["environment"]["UNSPOKEN_CONNECT"] == "tcp/world:7447"
        assert service["environment"]["UNSPOKEN_RUN"] == told["UNSPOKEN_RUN"]


def test_each_robot_shares_its_only_network_with_the_world_alone(config, robots):
    members = {network: set() for network in config["networks"]}
    for name, service in config["services"].items():
        for network in service["networks"]:
            members[network].add(name)
    assert sorted(members.values(), key=sorted) == sorted(({name, "world"} for name in robots), key=sorted)


def test_no_network_and_no_port_leads_outside(config):
    assert all(network["internal"] for network in config["networks"].values())
    assert not any("ports" in service for service in config["services"].values())
    assert not any("network_mode" in service for service in config["services"].values())


def test_no_container_has_privileges(config):
    for service in config["services"].values():
        assert service["cap_drop"] == ["ALL"]
        assert service["read_only"]
        assert not service.keys() & {"privileged", "cap_add", "ulimits", "user"}


def test_the_images_are_built_from_targets_of_the_containerfile(config):
    lines = (ROOT / "deploy" / "Containerfile").read_text().splitlines()
    targets = {line.split()[-1] for line in lines if line.startswith("FROM ")}
    for name, service in config["services"].items():
        build = service["build"]
        assert (ROOT / build["dockerfile"]).samefile(ROOT / "deploy" / "Containerfile")
        assert build["target"] == ("world" if name == "world" else "agent")
        assert build["target"] in targets


def test_the_build_context_holds_all_that_the_installation_reads():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    packages = {package.partition(".")[0] for package in project["tool"]["setuptools"]["packages"]}
    files = {"pyproject.toml", "constraints.txt", project["project"]["readme"], "LICENSE"}
    admitted = (ROOT / ".dockerignore").read_text().splitlines()
    assert packages | files <= {line.removeprefix("!") for line in admitted if line.startswith("!")}
