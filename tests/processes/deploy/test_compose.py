"""compose.yaml and compose.robot.yaml as Compose itself reads them, against the scenario of the first."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer

import agent.__main__
import world.__main__
from agent.process.options import parse_goal
from protocol.identity import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE
from protocol.scenario import load_scenario
from scenarios import find

ROOT = Path(__file__).parents[3]
COMPOSE = Path(sys.executable).parent / "docker-compose"
"""From compose-tool.txt: one version everywhere, whatever the machine has."""
ROBOT_ENVIRONMENT = ROOT / "deploy" / "robot.env.example"
KEY_FILES = {AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE}


def compose_config(file, *options, env_file="/dev/null", profile=""):
    """What Compose says to a file, without a container engine and without the machine's own settings."""
    return subprocess.run(
        [COMPOSE, "--file", file, "--env-file", env_file, f"--profile={profile}", "config", *options],
        env={},
        capture_output=True,
        text=True,
    )


def environment_variables(main):
    """Names of the environment variables that a command line reads; True for those it cannot do without."""
    app = typer.Typer()
    app.command()(main)
    return {option.envvar: option.required for option in typer.main.get_command(app).params if option.envvar}


def resolved(*arguments, **options):
    """A file with anchors, merges and defaults resolved."""
    read = compose_config(*arguments, "--format", "json", **options)
    assert read.returncode == 0, read.stderr
    return json.loads(read.stdout)


@pytest.fixture(scope="module")
def config():
    """compose.yaml, without the service that makes keys."""
    return resolved(ROOT / "compose.yaml")


@pytest.fixture(scope="module")
def one_robot():
    """The only service of compose.robot.yaml."""
    config = resolved(ROOT / "compose.robot.yaml", env_file=ROBOT_ENVIRONMENT)
    assert list(config["services"]) == ["robot"]
    return config["services"]["robot"]


@pytest.fixture(scope="module")
def robots(config):
    """The services of the robots by name."""
    return {name: service for name, service in config["services"].items() if name != "world"}


def test_compose_accepts_the_files_without_a_word():
    for name, env_file in {"compose.yaml": "/dev/null", "compose.robot.yaml": ROBOT_ENVIRONMENT}.items():
        checked = compose_config(ROOT / name, "--quiet", env_file=env_file)
        assert (checked.returncode, checked.stdout, checked.stderr) == (0, "", "")


def test_every_robot_of_8a_has_one_service_with_its_goal_and_estimates_those_of_others(config, robots):
    world = config["services"]["world"]["environment"]
    scenario = load_scenario(find(world["UNSPOKEN_SCENARIO"]))
    assert scenario == load_scenario(ROOT / "scenarios" / "8a.yaml")
    told = [service["environment"] for service in robots.values()]
    goals = {each["UNSPOKEN_ROBOT"]: parse_goal(each["UNSPOKEN_GOAL"]) for each in told}
    assert goals == {robot.id: robot.goal_pose() for robot in scenario.robots}
    assert len(told) == len(goals)
    assert {each["UNSPOKEN_GOALS"] for each in told} == {"ioc"}
    assert "UNSPOKEN_EXCHANGE_GOALS" not in world


def test_each_process_is_told_what_it_needs_and_nothing_that_it_does_not_know(config):
    for name, service in config["services"].items():
        check_variables(name, service, world.__main__.main if name == "world" else agent.__main__.main)


def check_variables(name, service, main):
    known, told = environment_variables(main), set(service["environment"])
    assert told <= set(known), name
    assert {variable for variable, required in known.items() if required} <= told, name


def test_robots_connect_to_the_world_in_the_same_run(config, robots):
    told = config["services"]["world"]["environment"]
    assert told["UNSPOKEN_LISTEN"] == "tls/0.0.0.0:7447"
    for service in robots.values():
        assert service["environment"]["UNSPOKEN_CONNECT"] == "tls/world:7447"
        assert service["depends_on"]["world"]["condition"] == "service_healthy"
        assert service["environment"]["UNSPOKEN_RUN"] == told["UNSPOKEN_RUN"]


def test_each_robot_shares_its_only_network_with_the_world_alone_and_none_leads_outside(config, robots):
    members = {network: set() for network in config["networks"]}
    for name, service in config["services"].items():
        assert not service.keys() & {"ports", "network_mode"}
        for network in service["networks"]:
            members[network].add(name)
    assert sorted(members.values(), key=sorted) == sorted(({name, "world"} for name in robots), key=sorted)
    assert all(network["internal"] for network in config["networks"].values())


def test_each_is_given_its_own_keys_and_no_others(config):
    files = {name: Path(secret["file"]) for name, secret in config["secrets"].items()}
    for name, service in config["services"].items():
        given = {each["target"]: files[each["source"]] for each in service["secrets"]}
        assert given.keys() == KEY_FILES
        assert all(path.name == target for target, path in given.items())
        assert {given[file].parent for file in (CERTIFICATE_FILE, KEY_FILE)} == {ROOT / "keys" / name}
        assert given[AUTHORITY_FILE].parent == ROOT / "keys" / "world"  # the same for all
        assert service["environment"]["UNSPOKEN_KEYS"] == "/run/secrets"
        assert "UNSPOKEN_INSECURE" not in service["environment"]


def test_no_container_has_privileges_or_goes_without_limits(config, one_robot):
    for service in [*config["services"].values(), one_robot]:
        assert service["cap_drop"] == ["ALL"]
        assert service["security_opt"] == ["no-new-privileges:true"]
        assert service["read_only"]
        assert int(service["mem_limit"]) == int(service["memswap_limit"]) <= 2**30
        assert 0 < service["pids_limit"] <= 256
        assert 0.0 < service["cpus"] <= 1.0  # an engine refuses more than it has
        assert not service.keys() & {"privileged", "cap_add", "ulimits", "user", "oom_score_adj"}


def test_robots_start_again_and_the_world_ends_with_its_verdict(config, robots, one_robot):
    assert "restart" not in config["services"]["world"]
    assert {service["restart"] for service in robots.values()} == {"on-failure"}
    assert one_robot["restart"] == "unless-stopped"


def test_making_keys_needs_no_network_and_one_capability():
    keys = resolved(ROOT / "compose.yaml", profile="keys")["services"]["keys"]
    assert keys["network_mode"] == "none"
    assert (keys["cap_drop"], keys["cap_add"]) == (["ALL"], ["CHOWN"])
    assert keys["read_only"]


def test_one_robot_is_told_what_it_needs(one_robot):
    check_variables("robot", one_robot, agent.__main__.main)
    parse_goal(one_robot["environment"]["UNSPOKEN_GOAL"])
    assert {each["target"] for each in one_robot["secrets"]} == KEY_FILES


@pytest.mark.parametrize("line", [line for line in ROBOT_ENVIRONMENT.read_text().splitlines() if "=" in line])
def test_one_robot_asks_for_each_variable_that_is_missing(tmp_path, line):
    less = tmp_path / "robot.env"
    less.write_text(ROBOT_ENVIRONMENT.read_text().replace(line, ""))
    checked = compose_config(ROOT / "compose.robot.yaml", "--quiet", env_file=less)
    assert checked.returncode != 0
    assert f"{line.partition('=')[0]} is missing a value" in checked.stderr
    assert "is expected" in checked.stderr


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
    packages |= {"deploy/agent", "deploy/world"}
    files = {"pyproject.toml", "constraints.txt", project["project"]["readme"], "LICENSE"}
    admitted = (ROOT / ".dockerignore").read_text().splitlines()
    assert packages | files <= {line.removeprefix("!") for line in admitted if line.startswith("!")}
