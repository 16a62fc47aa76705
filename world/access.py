"""Whom the world lets in, and what it lets them do."""

from dataclasses import dataclass
from pathlib import Path

from structlog.typing import FilteringBoundLogger

from protocol.endpoint import is_local
from protocol.keys import Keys
from protocol.passwords import PasswordError, read_users
from protocol.policy import access_control, rights_of
from protocol.session import SessionSettings, world_session

SPARE_SESSIONS = 8
"""Beyond two for each robot, which may come back before its old session is given up: for benches."""


class AccessError(Exception):
    """The world cannot be sure of who is who, or not open to whom it should; says what to do."""


@dataclass(frozen=True)
class Access:
    """What a world is told of who may connect.

    Attributes:
        listen: the endpoint at which robots connect.
        users: file with the names and passwords of the robots and the bench.
        insecure: whether others than processes of this machine may connect without certificates.
    """

    listen: str
    users: Path | None
    insecure: bool

    def session(self, keys: Keys, robots: tuple[str, ...], log: FilteringBoundLogger) -> SessionSettings:
        """The session that enforces the policy of a run, as far as names can be proven.

        Raises:
            AccessError: passwords are missing or unreadable, or the world would be open to the network.
        """
        if not is_local(self.listen):
            self._allow_network(log)
        if self.users is None:
            log.warning(
                "no policy: whoever connects may read and say anything",
                remedy="give every robot a password or a certificate: --users",
            )
            return world_session(self.listen, most_sessions=most_sessions(robots))
        self._check_users(robots)
        access = access_control(rights_of(keys, robots), "usernames")
        return world_session(self.listen, access, self.users, most_sessions(robots))

    def _allow_network(self, log: FilteringBoundLogger) -> None:
        if not self.insecure:
            raise AccessError(
                f"{self.listen} can be reached from other machines, and nothing there is encrypted: anyone "
                "on the network could read poses, and drive robots. Listen on this machine only, such as at "
                "tcp/127.0.0.1:7447, or say --insecure if the network is yours alone."
            )
        log.warning(
            "insecure: anyone on the network can read what is said here, and pretend to be a robot",
            listen=self.listen,
        )

    def _check_users(self, robots: tuple[str, ...]) -> None:
        assert self.users is not None
        try:
            known = read_users(self.users)
        except PasswordError as error:
            raise AccessError(str(error)) from error
        if missing := [robot for robot in robots if robot not in known]:
            raise AccessError(
                f"{self.users}: no password for robot {', '.join(missing)}; a line name:password is expected "
                "for every robot of the scenario"
            )


def most_sessions(robots: tuple[str, ...]) -> int:
    """How many may be connected at a time: one robot cannot take an unlimited number of places."""
    return 2 * len(robots) + SPARE_SESSIONS
