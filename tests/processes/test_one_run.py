"""One run as the machine sees it: its processes, what each is told, its secrets, and its end by Ctrl-C."""

import signal
from types import SimpleNamespace

import pytest
import zenoh
from process_helpers import Bench, endless, environment

from protocol.messages import Mind

STRANGE = {"ROBOT": "9", "GOAL": "9,9,9", "RUN": "other", "CLOCK": "realtime", "EXCHANGE_GOALS": "1"}
"""Settings of the user's, for processes started one by one; a run has its own."""


def heard_by_a_cheat(run):
    """What one hears who has robot 1's password, listens to everything, and speaks as others."""
    heard, keys = set(), run.keys()
    with run.listening("1") as cheat, run.watched() as truths:
        cheat.declare_subscriber("**", lambda sample: heard.add(str(sample.key_expr)))
        cheat.declare_subscriber(keys.pose("1"), lambda sample: heard.add(str(sample.key_expr)))
        truths.wait_for(lambda _: heard)
        for key in (keys.pose("2"), keys.command("2"), keys.truth, "unspoken/secret"):
            cheat.put(key, b"psst", allowed_destination=zenoh.Locality.REMOTE)
        last = truths.wait_for(lambda _: True)
        truths.reached(last.step + 10)
    return heard, last.step


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """An interrupted run, and what could be seen of it while it went on."""
    here = tmp_path_factory.mktemp("here")
    for name in ("agent", "world", "protocol", "scenarios"):
        (here / name).mkdir()
        (here / name / "__init__.py").write_text(f"raise RuntimeError('the wrong {name}')")
        (here / name / "__main__.py").touch()
    endless(here / "endless.yaml", 2)
    strange = {f"UNSPOKEN_{name}": value for name, value in STRANGE.items()}
    with Bench(here / "out", "run", "endless.yaml", cwd=here, env=strange) as run:
        run.reach(3)
        children, folder = run.children(), run.folder
        given = {"world": environment(run.pid("world"))}
        given |= {robot: environment(run.pid("agent", robot)) for robot in ("1", "2")}
        seen = SimpleNamespace(run=run, children=children, given=given, folder_mode=folder.stat().st_mode)
        users = (folder / "users").read_text()
        seen.secrets = {line.partition(":")[2] for line in users.splitlines()}
        seen.heard = heard_by_a_cheat(run)
        seen.modes = [path.stat().st_mode & 0o777 for path in (folder / "users", *folder.glob("*.password"))]
        run.signal(signal.SIGINT)
        run.signal(signal.SIGINT)  # of somebody impatient
        seen.status = run.end()
        yield seen


def test_there_is_one_process_for_the_world_and_one_for_each_robot(seen):
    assert sorted(line[-2:] for line in seen.children.values()) == [["-m", "agent"]] * 2 + [["-m", "world"]]


def test_ctrl_c_ends_it_with_its_output_and_leaves_nothing_else(seen):
    assert (seen.status, seen.run.complained) == (1, "")
    assert "Interrupted" in seen.run.told
    seen.run.leaves_nothing(seen.children)
    assert seen.run.summary["verdict"] == "interrupted"
    assert seen.run.summary["steps"] >= 3
    assert (seen.run.out / "paths.png").exists()


def test_no_command_line_tells_a_goal_and_no_process_knows_that_of_another(seen):
    assert not any("900" in part for line in seen.children.values() for part in line)
    assert seen.given["1"]["UNSPOKEN_GOAL"] == "900.0,0.0,0.0"
    assert seen.given["2"]["UNSPOKEN_GOAL"] == "900.0,2.0,0.0"
    needed = {"ROBOT", "GOAL", "CONNECT", "RUN", "PASSWORD_FILE", "PARENT"}
    choices = {"GOALS", "SOLVER", "ITERATIONS", "BUDGET_MS", "RESERVE"}
    for robot in ("1", "2"):
        told = {name.removeprefix("UNSPOKEN_") for name in seen.given[robot] if name.startswith("UNSPOKEN_")}
        assert needed <= told <= needed | choices, robot
    assert "UNSPOKEN_GOAL" not in seen.given["world"]


def test_settings_of_the_users_environment_do_not_reach_the_processes(seen):
    assert "clock=lockstep" in seen.run.log("world")
    assert "exchange_goals=False" in seen.run.log("world")
    assert seen.run.summary["clock"] == "lockstep"


def test_a_robot_hears_its_own_poses_alone_and_nobody_hears_what_it_says_as_others(seen):
    """The policy is in force; silence/test_cheats has all ways around it."""
    heard, step = seen.heard
    assert heard == {seen.run.keys().pose("1")}
    assert seen.run.summary["refused"] == {}
    assert seen.run.summary["deadline_misses"] == 0
    assert {mind.step for mind in seen.run.messages(Mind) if mind.robot == "2"} >= set(range(step))


def test_passwords_show_up_nowhere_but_in_files_of_their_owner(seen):
    assert len(seen.secrets) == 3
    assert seen.modes == 4 * [0o600]  # of the world, the bench and two robots
    assert seen.folder_mode & 0o777 == 0o700
    shown = [seen.run.told, seen.run.complained, str(seen.children), str(seen.given)]
    written = [path.read_bytes() for path in seen.run.out.rglob("*") if path.is_file()]
    for secret in seen.secrets:
        assert not any(secret in text for text in shown)
        assert not any(secret.encode() in content for content in written)
