"""Passwords for the processes of one run on this machine, in files that only their owner can read."""

from collections.abc import Iterable
from pathlib import Path

from protocol.keys import BENCH_NAME
from protocol.passwords import Login, new_passwords, write_password, write_users


class Logins:
    """What each process is told at its start to prove who it is.

    Args:
        directory: for the files, which nobody else may look into; it outlives the run.
        robots: their ids.

    Raises:
        OSError: the files cannot be written.
    """

    def __init__(self, directory: Path, robots: Iterable[str]) -> None:
        self._directory = directory
        self._users = directory / "users"
        passwords = new_passwords([BENCH_NAME, *robots])
        write_users(self._users, passwords)
        self.bench = Login(BENCH_NAME, passwords.pop(BENCH_NAME))
        self.bench_file: Path | None = directory / f"{BENCH_NAME}.password"
        write_password(self.bench_file, self.bench.password)
        self._passwords = passwords
        self._files = {robot: directory / f"{robot}.password" for robot in passwords}
        for robot, password in passwords.items():
            write_password(self._files[robot], password)

    def of_world(self) -> dict[str, str]:
        """Settings of the world's process."""
        return {"users": str(self._users)}

    def of_robot(self, robot: str) -> dict[str, str]:
        """Settings of a robot's process."""
        return {"password_file": str(self._files[robot])}

    def of_relay(self, robot: str) -> dict[str, str]:
        """Settings of a process that stands for a robot at the world, and for the world at the robot.

        Raises:
            OSError: its file of users cannot be written.
        """
        users = self._directory / f"{robot}.users"
        write_users(users, {robot: self._passwords[robot]})
        return {"users": str(users), **self.of_robot(robot)}


class NoLogins:
    """For a run without a policy: nobody proves anything."""

    bench = bench_file = None

    def of_world(self) -> dict[str, str]:
        """Settings of the world's process."""
        return {}

    def of_robot(self, _robot: str) -> dict[str, str]:
        """Settings of a robot's process."""
        return {}

    def of_relay(self, _robot: str) -> dict[str, str]:
        """Settings of a process between a robot and the world."""
        return {}
