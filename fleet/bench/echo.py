"""``python -m fleet.bench.echo``: a robot on the bus that answers every pose at once, without a thought."""

import os
from datetime import UTC, datetime
from pathlib import Path

import zenoh

from agent.process.inbox import Inbox
from chassis.lean import structlog
from chassis.process import end_with_parent, on_wish_to_end
from protocol.codec import encode
from protocol.identity import client_identity
from protocol.keys import Keys
from protocol.messages import Command, Observation
from protocol.session import client_session


def main() -> None:
    """Answer until SIGTERM, in a world that is there already."""
    end_with_parent()
    robot, keys = os.environ["UNSPOKEN_ROBOT"], Keys(os.environ["UNSPOKEN_RUN"])
    inbox = Inbox(structlog.get_logger("echo"))
    on_wish_to_end(inbox.close)
    connect = os.environ["UNSPOKEN_CONNECT"]
    files = (os.environ.get(f"UNSPOKEN_{name}") for name in ("PASSWORD_FILE", "KEYS"))
    password, folder = (Path(path) if path else None for path in files)
    identity = client_identity(robot, connect, password, folder, datetime.now(UTC))
    with zenoh.open(client_session(connect, identity).to_zenoh()) as session:
        _poses = session.declare_subscriber(
            keys.pose(robot), lambda sample: inbox.store(sample.payload.to_bytes())
        )
        _presence = session.liveliness().declare_token(keys.alive(robot))
        while isinstance(observation := inbox.next(), Observation):
            nothing = Command.withheld_at(observation.epoch, robot, observation.step)
            session.put(keys.command(robot), encode(nothing))


if __name__ == "__main__":
    main()
