"""compose.yaml on a real container engine: the images are built, 8a is driven, and robots are kept apart."""

import json
import re
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import container_engine
import debian_packages
import pytest
import reach
from container_engine import COMPOSE, Engine
from container_images import OFFLINE, copy_sources, import_base
from needed import need

ROBOTS = tuple(f"robot-{robot}" for robot in range(1, 9))
PATIENCE_S = 300.0
PROBE = Path(reach.__file__).read_text()

pytestmark = [pytest.mark.alone, pytest.mark.timeout(3600)]


class Project:
    """compose.yaml in a copy of the repository, on an engine."""

    def __init__(self, engine: Engine, folder: Path) -> None:
        self.engine = engine
        self.folder = folder

    def compose(self, *arguments: str, **env: str) -> str:
        return self.engine.run(COMPOSE, *arguments, cwd=self.folder, env=env)

    def docker(self, *arguments: str) -> str:
        return self.engine.docker(*arguments)

    def inspect(self, service: str) -> dict:
        return json.loads(self.docker("inspect", f"unspoken-{service}-1"))[0]

    def is_healthy(self, service: str) -> bool:
        """As the engine sees it."""
        return self.inspect(service)["State"]["Health"]["Status"] == "healthy"

    def is_running(self, service: str) -> bool:
        return self.inspect(service)["State"]["Running"]

    def addresses(self, service: str) -> list[str]:
        return [each["IPAddress"] for each in self.inspect(service)["NetworkSettings"]["Networks"].values()]

    def reached_from(self, service: str, hosts: list[str]) -> set[str]:
        """Which of these hosts answer to a container, with what is in its image."""
        return set(self.docker("exec", f"unspoken-{service}-1", "python", "-c", PROBE, *hosts).split())

    def joined(self, service: str) -> int:
        """How often a robot's present container has joined a world."""
        return len(re.findall(r"\bjoined\b", self.docker("logs", f"unspoken-{service}-1")))

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for something that can only be asked for; the run must not end meanwhile."""
        give_up_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < give_up_s, f"{what} did not come:\n{self.compose('logs')}"
            time.sleep(0.2)


@pytest.fixture
def project(tmp_path) -> Iterator[Project]:
    """With images that were built without network access, and with keys."""
    need(container_engine.COMMANDS | debian_packages.COMMANDS)
    sources = tmp_path / "sources"
    sources.mkdir()
    with Engine() as engine:
        import_base(engine, tmp_path / "base")
        project = Project(engine, copy_sources(sources))
        project.compose("--profile", "keys", "build", "world", "robot-1", "keys", **OFFLINE)
        project.compose("run", "--rm", "keys")
        yield project
        project.compose("down")


def test_8a_is_driven_by_containers_that_are_kept_apart_and_may_crash_and_be_updated(project):
    check_images(project)
    check_a_run_to_its_verdict(project)
    check_crash_and_update(project)


def check_images(project: Project) -> None:
    """Each holds what it needs and nothing else, and runs as nobody in particular."""
    everything = ("agent", "protocol", "world", "fleet", "scenarios", "matplotlib", "casadi", "numba")
    for image, packages in {
        "unspoken-agent": {"agent", "protocol", "numba"},
        "unspoken-world": {"protocol", "world", "scenarios"},
        "unspoken-bench": set(everything),
    }.items():
        look = "import sys, importlib.util as u; print(*(n for n in sys.argv[1:] if u.find_spec(n)))"
        found = project.docker("run", "--rm", "--entrypoint", "python", image, "-P", "-c", look, *everything)
        assert set(found.split()) == packages, image
        who = ("-c", "import os; print(os.getuid())")
        assert project.docker("run", "--rm", "--entrypoint", "python", image, *who).strip() == "10001"
    warm = ("-P", "-m", "agent.process.warm")
    for image in ("unspoken-agent", "unspoken-bench"):
        told = project.docker("run", "--rm", "--read-only", "--entrypoint", "python", image, *warm)
        assert told.startswith("the solver is compiled")


def check_a_run_to_its_verdict(project: Project) -> None:
    """By the command of compose.yaml; before it, who reaches whom, while the world waits for a robot."""
    missing, last = ROBOTS[0], ROBOTS[-1]
    project.compose("up", "--detach", "world", *ROBOTS[:-1])
    check_robots_are_kept_apart(project, ROBOTS[:-1])
    project.compose("stop", missing)  # for the run would begin with the last one
    project.compose("up", "--detach", last)
    check_reach(project, last, [each for each in ROBOTS if each != missing])
    project.until(
        lambda: all(project.is_healthy(each) for each in ("world", *ROBOTS) if each != missing), "health"
    )
    told = project.compose("up", "--no-color", "--exit-code-from", "world")
    assert "verdict=arrived" in told
    assert "no policy" not in told
    project.compose("down")


def check_robots_are_kept_apart(project: Project, robots: Sequence[str]) -> None:
    """By address and by name, in all networks; a robot in another's network does reach it."""
    with ThreadPoolExecutor(len(robots)) as threads:
        list(threads.map(lambda robot: check_reach(project, robot, robots), robots))
    one, other, *_ = robots
    hosts = [other, *project.addresses(other)]
    project.docker("network", "connect", f"unspoken_{other}", f"unspoken-{one}-1")
    assert project.reached_from(one, hosts) == set(hosts)
    project.docker("network", "disconnect", f"unspoken_{other}", f"unspoken-{one}-1")
    assert not project.reached_from(one, hosts)


def check_reach(project: Project, robot: str, robots: Sequence[str]) -> None:
    """A robot reaches itself and, in their common network, the world; and nothing else."""
    hosts = [host for each in {"world", robot, *robots} for host in (each, *project.addresses(each))]
    world = project.inspect("world")["NetworkSettings"]["Networks"][f"unspoken_{robot}"]["IPAddress"]
    own = {robot, *project.addresses(robot)}
    assert project.reached_from(robot, hosts) == {"world", world} | own


def check_crash_and_update(project: Project) -> None:
    """One robot crashes and one gets another image while the others drive: the run goes on."""
    project.docker("tag", "unspoken-agent", "unspoken-agent:next")
    project.compose("up", "--detach")
    started = {each: project.inspect(each)["State"]["StartedAt"] for each in ("world", *ROBOTS)}
    project.until(lambda: "all robots present" in project.docker("logs", "unspoken-world-1"), "the start")
    project.engine.kill("unspoken-robot-3-1")
    project.compose("up", "--detach", "--no-deps", "robot-5", UNSPOKEN_TAG="next")
    project.until(lambda: project.joined("robot-3") == 2 and project.joined("robot-5") == 1, "their return")
    assert project.is_running("world")
    assert project.inspect("robot-3")["RestartCount"] == 1
    assert project.inspect("robot-5")["Config"]["Image"] == "unspoken-agent:next"
    for each in {"world", *ROBOTS} - {"robot-3", "robot-5"}:
        assert project.inspect(each)["State"]["StartedAt"] == started[each], each
    ended = project.docker("wait", "unspoken-world-1").strip()
    told = project.docker("logs", "unspoken-world-1")
    assert ended == "0", told
    assert "verdict=arrived" in told
