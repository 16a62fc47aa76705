"""``python -m fleet.bench.echo``: a robot on the bus that answers every pose at once, without a thought."""

import os

import structlog
import zenoh

from agent.inbox import Inbox
from protocol.codec import encode
from protocol.keys import Keys
from protocol.messages import Command
from protocol.session import client_session
from protocol.signals import on_wish_to_end


def main() -> None:
    """Answer until SIGTERM, in a world that is there already."""
    robot, keys = os.environ["UNSPOKEN_ROBOT"], Keys(os.environ["UNSPOKEN_RUN"])
    inbox = Inbox(structlog.get_logger("echo"))
    on_wish_to_end(inbox.close)
    with zenoh.open(client_session(os.environ["UNSPOKEN_CONNECT"]).to_zenoh()) as session:
        _poses = session.declare_subscriber(
            keys.pose(robot), lambda sample: inbox.store(sample.payload.to_bytes())
        )
        _presence = session.liveliness().declare_token(keys.alive(robot))
        while (observation := inbox.next()) is not None:
            command = Command(
                epoch=observation.epoch,
                robot=robot,
                step=observation.step,
                turn_rate_radps=0.0,
                acceleration_mps2=0.0,
            )
            session.put(keys.command(robot), encode(command))


if __name__ == "__main__":
    main()
