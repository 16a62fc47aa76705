"""Whom the world lets in, and what it lets them do."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from structlog.typing import FilteringBoundLogger

from chassis.refusal import Refusal
from protocol.codec import MessageError, OtherVersionError, decode
from protocol.device_keys import DeviceKeys, check_name, load_device_keys
from protocol.identity import check_keys_fit, is_local, read_users
from protocol.keys import WORLD_NAME, Keys
from protocol.messages import Joining
from protocol.policy import Proof, access_control, rights_of
from protocol.session import SessionSettings, world_session
from protocol.version import PROTOCOL_VERSION, disagreement

MOST_TOLD = 256
"""Lines: a robot that says something else each time cannot fill the log."""


class Versions:
    """Remembers what each robot has said last; the log gets a line for each that differs, once.

    The policy lets a robot ask for the scene on its own key only, so none can say this of another.

    Args:
        log: for people.
    """

    def __init__(self, log: FilteringBoundLogger) -> None:
        self._log = log
        self._told: set[tuple[str, str]] = set()
        self._differing: dict[str, str] = {}

    def hear(self, questions: Iterable[tuple[str, bytes]]) -> None:
        """Robots have asked for the scene.

        Args:
            questions: the robot of the key and the payload of its question.
        """
        for robot, payload in questions:
            try:
                decode(Joining, payload)
            except OtherVersionError as error:
                self._differs(robot, disagreement(robot, error.version, PROTOCOL_VERSION))
            except MessageError as error:
                unknown = f"robot {robot} does not say which version of the protocol it speaks"
                self._differs(robot, f"{unknown}: {error}")
            else:
                self._differing.pop(robot, None)

    def account(self, missing: Iterable[str]) -> str:
        """What is to be said of those missing robots that differ, as sentences; empty if there are none."""
        told = (self._differing[robot] for robot in missing if robot in self._differing)
        return "".join(f" {text[0].upper()}{text[1:]}." for text in told)

    def _differs(self, robot: str, text: str) -> None:
        self._differing[robot] = text
        if (robot, text) not in self._told and len(self._told) < MOST_TOLD:
            self._log.warning(text, robot=robot)
            self._told.add((robot, text))


SPARE_SESSIONS = 8
"""Beyond two for each robot, which may come back before its old session is given up: for benches."""


@dataclass(frozen=True)
class Access:
    """What a world is told of who may connect.

    Attributes:
        listen: the endpoint at which robots connect.
        users: file with the names and passwords of the robots and the bench.
        keys: folder with the world's own keys; robots and bench then need theirs.
        insecure: whether others than processes of this machine may connect without certificates.
    """

    listen: str
    users: Path | None = None
    keys: Path | None = None
    insecure: bool = False

    def session(self, keys: Keys, robots: tuple[str, ...], log: FilteringBoundLogger) -> SessionSettings:
        """The session that enforces the policy of a run, as far as names can be proven.

        Raises:
            Refusal: passwords or keys cannot be used, or the world would be open to the network.
        """
        if self.users is not None and self.keys is not None:
            raise Refusal("passwords and keys are given; --users or --keys is expected")
        proof = self._proof(robots, log)
        access = None
        if proof is None:
            log.warning(
                "no policy: whoever connects may read and say anything",
                remedy="give every robot a certificate or a password: --keys or --users",
            )
        else:
            by: Proof = "cert_common_names" if isinstance(proof, DeviceKeys) else "usernames"
            access = access_control(rights_of(keys, robots), by)
        return world_session(self.listen, access, proof, most_sessions(robots))

    def _proof(self, robots: tuple[str, ...], log: FilteringBoundLogger) -> Path | DeviceKeys | None:
        check_keys_fit(self.listen, self.keys)
        if self.keys is not None:
            return self._own_keys(self.keys, log)
        if not is_local(self.listen):
            self._allow_network(log)
        if self.users is not None:
            self._check_users(read_users(self.users), robots)
        return self.users

    def _own_keys(self, folder: Path, log: FilteringBoundLogger) -> DeviceKeys:
        now = datetime.now(UTC)
        own = load_device_keys(folder, now)
        check_name(own, WORLD_NAME)
        if warning := own.warning(now):
            log.warning(warning)
        return own

    def _allow_network(self, log: FilteringBoundLogger) -> None:
        if not self.insecure:
            raise Refusal(
                f"{self.listen} can be reached from other machines, and nothing there is encrypted: anyone "
                "on the network could read poses, and drive robots. Listen at tls/… with --keys, or on this "
                "machine only, such as at tcp/127.0.0.1:7447; or say --insecure if the network is yours "
                "alone."
            )
        log.warning(
            "insecure: anyone on the network can read what is said here, and pretend to be a robot",
            listen=self.listen,
        )

    def _check_users(self, known: tuple[str, ...], robots: tuple[str, ...]) -> None:
        if missing := [robot for robot in robots if robot not in known]:
            raise Refusal(
                f"{self.users}: no password for robot {', '.join(missing)}; a line name:password is expected "
                "for every robot of the scenario"
            )


def most_sessions(robots: tuple[str, ...]) -> int:
    """How many may be connected at a time: one robot cannot take an unlimited number of places."""
    return 2 * len(robots) + SPARE_SESSIONS
