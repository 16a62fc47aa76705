"""A container engine of the tests' own: in namespaces of its own, with which everything in it ends."""

import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import mkdtemp
from typing import Self

import psutil

COMMANDS = {
    "docker": "docker.io",
    "dockerd": "docker.io",
    "tini": "tini",
    "iptables": "iptables",
    "unshare": "util-linux",
    "setpriv": "util-linux",
    "ip": "iproute2",
}
"""And where they come from."""
COMPOSE = Path(sys.executable).parent / "docker-compose"
PATIENCE_S = 60.0
LONGEST_S = 1800.0
"""For one command; an image of an agent takes minutes, in which the solver is compiled."""
_APART = (
    *("setpriv", "--pdeathsig", "KILL"),
    *("unshare", "--net", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc"),
)
# Names are looked up in vain outside: that is to be short.
_START = """
mount -t tmpfs tmpfs /run && ip link set lo up && exec dockerd --host "unix://$1/socket" \
    --data-root "$1/data" --exec-root /run/docker --pidfile /run/docker.pid \
    --dns-opt timeout:3 --dns-opt attempts:1
"""


class Engine:
    """A running container engine; gone after the block, with its containers, networks and images.

    The first process of its process namespace takes all others with it when it ends, and ends with the tests,
    however these end.
    """

    def __enter__(self) -> Self:
        self.folder = Path(mkdtemp(prefix="engine-"))  # short, since a socket has to have it in its name
        try:
            self._start()
        except BaseException:
            self._remove()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        try:
            if containers := self.docker("ps", "--all", "--quiet").split():
                self.docker("rm", "--force", *containers)
        finally:
            self._end()
            self._remove()

    def docker(self, *arguments: object, **options: object) -> str:
        """What a command of the engine prints; it must succeed."""
        return self.run("docker", *arguments, **options)

    def run(self, *command: object, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> str:
        """What a command that speaks to the engine prints; it must succeed."""
        done = subprocess.run(
            list(map(str, command)),
            cwd=cwd,
            env=self.environment | (env or {}),
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
        )
        assert done.returncode == 0, f"{command}: {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    @property
    def environment(self) -> dict[str, str]:
        """In which commands find the engine, and nothing of the machine's own settings."""
        return {
            "PATH": f"{os.environ['PATH']}:/usr/sbin:/sbin",
            "HOME": str(self.folder),
            "DOCKER_HOST": f"unix://{self.folder}/socket",
        }

    def kill(self, container: str) -> None:
        """Let a container's process crash, which is not the same as to stop the container."""
        pid = self.docker("inspect", "--format", "{{.State.Pid}}", container).strip()
        self.run("nsenter", "--target", self._first.pid, "--pid", "--mount", "--", "kill", "-KILL", pid)

    def _start(self) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notified:
            notified.bind(str(self.folder / "notify"))
            notified.settimeout(PATIENCE_S)
            with (self.folder / "log").open("wb") as log:
                self._process = subprocess.Popen(
                    [*_APART, "tini", "--", "sh", "-euc", _START, "sh", str(self.folder)],
                    env=self.environment | {"NOTIFY_SOCKET": str(self.folder / "notify")},
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                )
            try:
                while b"READY=1" not in notified.recv(4096):
                    pass
            except TimeoutError:
                self._process.kill()
                self._process.wait()
                raise AssertionError((self.folder / "log").read_text()) from None
        [self._first] = psutil.Process(self._process.pid).children()

    def _end(self) -> None:
        self._first.send_signal(signal.SIGTERM)
        try:
            self._process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._first.kill()
            self._process.wait()

    def _remove(self) -> None:
        shutil.rmtree(self.folder)
