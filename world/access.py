"""Whom the world lets in, and what it lets them do."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from pydantic import AfterValidator, Field
from structlog.typing import FilteringBoundLogger

from chassis.files import Record
from chassis.healthy import HELP as WATCH_PORT_HELP
from chassis.refusal import Refusal
from protocol.identity import DeviceKeys, check_keys_fit, check_name, is_local, load_device_keys, read_users
from protocol.keys import WORLD_NAME, Keys, checked_name
from protocol.policy import Proof, access_control, rights_of
from protocol.session import SessionSettings, world_session

SPARE_SESSIONS = 8
"""Beyond two for each robot, which may come back before its old session is given up: for benches."""

ListenEndpoint = Annotated[str, Field(description="Zenoh endpoint to listen on.")]
WaitS = Annotated[float, Field(ge=0.0, le=86_400.0)]
"""A time that somebody can wait."""


class Access(Record):
    """Options: at which endpoint the world lets whom in."""

    listen: ListenEndpoint = "tcp/127.0.0.1:7447"
    users: Annotated[
        Path | None, typer.Option(show_default="none: any client can read and send anything")
    ] = Field(
        None,
        description="File with a line name:password for every robot and @bench, readable only by you. "
        "It enables the policy: each client can do only what it is granted.",
    )
    keys: Annotated[Path | None, typer.Option(show_default="none")] = Field(
        None,
        description="Folder with the world's keys, created by 'unspoken keys', for an endpoint tls/…; "
        "instead of passwords.",
    )
    insecure: Annotated[bool, typer.Option("--insecure")] = Field(
        False, description="Accept connections from other machines without encryption."
    )

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
            now = datetime.now(UTC)
            own = load_device_keys(self.keys, now)
            check_name(own, WORLD_NAME)
            if warning := own.warning(now):
                log.warning(warning)
            return own
        if not is_local(self.listen):
            self._allow_network(log)
        known = read_users(self.users) if self.users is not None else robots
        if missing := [robot for robot in robots if robot not in known]:
            raise Refusal(
                f"{self.users}: no password for robot {', '.join(missing)}; a line name:password is expected "
                "for every robot of the scenario"
            )
        return self.users

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


class HostOptions(Access):
    """Options of every process at which robots connect."""

    run: Annotated[str, AfterValidator(checked_name)] = Field(
        "run", description="Name of the run, the first part of all its Zenoh keys."
    )
    start_timeout: WaitS = Field(60.0, description="Seconds to wait for all robots to join.")
    watch_port: Annotated[int | None, typer.Option(show_default="none")] = Field(
        None, ge=0, le=65535, description=WATCH_PORT_HELP
    )


def most_sessions(robots: tuple[str, ...]) -> int:
    """How many may be connected at a time: one robot cannot take an unlimited number of places."""
    return 2 * len(robots) + SPARE_SESSIONS
