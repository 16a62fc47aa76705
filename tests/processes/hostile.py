"""``python hostile.py endpoint name password-file key count kind``: a robot that says what it should not.

``flood`` puts small payloads as fast as it can until it is ended; ``fuzz`` puts ``count`` random or mutated
payloads, none of which is valid, waits for room rather than lose one, and ends.
"""

import random
import sys
import time
from pathlib import Path

import zenoh

from protocol.codec import encode
from protocol.identity import Login, read_password
from protocol.keys import Keys
from protocol.messages import Command, Mind, Timings
from protocol.session import client_session

ANSWER_S = 200.0
WRONG_EPOCH = 2**62 + 1
"""Of no world, however its other bytes are changed: valid messages are refused too."""


def base(key: str) -> bytes:
    """A valid message for this key, of an epoch that never was."""
    robot = key.rpartition("/")[2]
    if Keys(key.split("/")[1]).kind_of(key) == "command":
        said = {"turn_rate_radps": 0.1, "acceleration_mps2": 0.2}
        return encode(Command(epoch=WRONG_EPOCH, robot=robot, step=3, **said))
    thought = {
        "decision": 3,
        "cut_short_at": None,
        "arrived": False,
        "estimates": {},
        "prediction": {robot: ((0.0, 1.0), (2.0, 3.0))},
        "plan": ((0.0, 1.0),),
        "failed": (),
        "solver_failures": 0,
        "timings_ms": Timings(),
    }
    return encode(Mind(epoch=WRONG_EPOCH, robot=robot, step=3, **thought))


def payloads(key: str, count: int) -> list[bytes]:
    """Random bytes, and valid messages with bytes changed, cut off, doubled or put in."""
    lots, valid = random.Random(count), base(key)
    made = []
    for number in range(count):
        if number % 2:
            made.append(lots.randbytes(lots.choice((0, 1, 7, 150, 2000))))
            continue
        changed = bytearray(valid)
        for _ in range(lots.randint(0, 4)):
            changed[lots.randrange(len(changed))] = lots.randrange(256)
        cut = lots.randrange(len(changed) + 1) if lots.random() < 0.2 else len(changed)
        made.append(bytes(changed[:cut]) * lots.choice((1, 1, 1, 2)))
    return made


def main(endpoint: str, name: str, password_file: str, key: str, count: str, kind: str) -> None:
    """Connect as this robot and put."""
    login = Login(name, read_password(Path(password_file)))
    with zenoh.open(client_session(endpoint, login).to_zenoh()) as session:
        publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
        if kind == "fuzz":
            for payload in payloads(key, int(count)):
                publisher.put(payload)
            # The answer comes when all before it has been taken; closing at once would cut some off. On a
            # busy machine a question may be lost: it is asked until it is answered, as robots do.
            scene, give_up_s = Keys(key.split("/")[1]).scene_for(name), time.monotonic() + ANSWER_S
            while not any(reply.ok for reply in session.get(scene, timeout=ANSWER_S)):
                assert time.monotonic() < give_up_s
        while kind == "flood":
            publisher.put(b"flood")


if __name__ == "__main__":
    main(*sys.argv[1:])
