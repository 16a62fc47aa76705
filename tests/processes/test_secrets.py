"""Passwords of a run: on no command line, in no environment, log or output, readable by their owner alone."""

import re
import signal
import subprocess
import sys
from pathlib import Path

from process_helpers import endless, environment


def test_passwords_show_up_nowhere_but_in_files_of_their_owner(tmp_path, bench):
    run = bench("out", "run", endless(tmp_path / "endless.yaml", 2))
    run.reach(1)
    [endpoint] = re.findall(r"listen=(\S+)", run.log("world"))
    folder = Path(endpoint.removeprefix("unixsock-stream/")).parent
    secrets = [line.partition(":")[2] for line in (folder / "users").read_text().splitlines()]
    assert len(set(secrets)) == 3
    files = [folder / "users", *folder.glob("*.password")]
    assert len(files) == 4  # of the world, the bench and two robots
    assert {path.stat().st_mode & 0o777 for path in files} == {0o600}
    assert folder.stat().st_mode & 0o777 == 0o700
    children = run.children()
    shown = [str(children.values()), *(str(environment(pid)) for pid in children)]
    run.signal(signal.SIGINT)
    assert run.end() == 1
    shown += [run.told, run.complained]
    written = [path.read_bytes() for path in run.out.rglob("*") if path.is_file()]
    for secret in secrets:
        assert not any(secret in text for text in shown)
        assert not any(secret.encode() in content for content in written)
    run.leaves_nothing(children)


def test_a_robot_that_cannot_prove_itself_says_so_and_ends(tmp_path):
    agent = [sys.executable, "-m", "agent", "--robot", "1", "--goal", "1,0,0"]
    for arguments, told in (
        (["--password-file", str(tmp_path / "none")], "cannot be read: No such file"),
        (["--keys", str(tmp_path)], "an endpoint such as tls/world.local:7447 is expected with --keys"),
    ):
        ended = subprocess.run([*agent, *arguments], capture_output=True, text=True, timeout=60)
        assert ended.returncode == 2
        assert told in ended.stderr
        assert "Traceback" not in ended.stderr
