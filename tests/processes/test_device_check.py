"""``unspoken agent --check`` beside a robot that drives."""

import json
import signal
import sys

import pytest
from process_helpers import endless

from protocol.identity import new_passwords, write_password, write_users


@pytest.fixture
def told(tmp_path, endpoint):
    """The file of robot 1, with a password that its world knows."""
    passwords = new_passwords(["1", "@bench"])
    write_users(tmp_path / "users", passwords)
    write_password(tmp_path / "secret", passwords["1"])
    path = tmp_path / "agent.yaml"
    path.write_text(
        f"robot: 1\ngoal: {{x_m: 900, y_m: 0, heading_rad: 0}}\nconnect: {endpoint}\npassword_file: secret\n"
    )
    path.chmod(0o600)
    return path


@pytest.mark.slow
def test_a_device_is_checked_while_its_robot_drives(process, endpoint, told, tmp_path):
    options = ("--listen", endpoint, "--users", tmp_path / "users")
    world = process("world", "world", "--scenario", endless(tmp_path / "endless.yaml", 1), *options)
    robot = process("robot", "agent", env={"UNSPOKEN_CONFIG": told})
    world.tells("all robots present")
    device = (sys.executable, "-c", "from agent import main; main()")
    check = process("check", "agent", "--config", told, "--check", "--json", program=device)
    status, found = check.end(), json.loads(check.told)
    assert check.complained == ""
    items = {each["item"]: each for each in found["items"]}
    for item in ("configuration", "credentials", "steady clock", "world", "kernels"):
        assert items[item]["state"] == "ok", items[item]
    assert "1 robot as in the world" in items["decision time"]["found"]
    failed = [each for each in found["items"] if each["state"] == "failed"]
    assert (status, found["ready"]) == ((1, False) if failed else (0, True))
    assert robot.running
    world.signal(signal.SIGTERM)
    assert world.end() == 1
    assert "refused_commands={}" in world.told
    for said in ("robot lost", "robot returned", "refused", "version"):
        assert f" {said} " not in world.told
