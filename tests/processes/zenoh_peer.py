"""A Zenoh peer as one has it without this project: it scouts and gossips, listens or connects, and greets.

Run as ``python zenoh_peer.py listen tcp/10.0.0.1:7448``, which prints all it gets until it is ended, or with
``connect``, which says hello and ends.
"""

import json
import signal
import sys
import threading

import zenoh

CONNECT_MS = 3000
GREETING = "hello from my namespace"


def listen(endpoint: str) -> None:
    with zenoh.open(_config({"listen": {"endpoints": [endpoint]}})) as session:
        session.declare_subscriber("**", lambda sample: print(sample.payload.to_string()))
        print("ready")
        signal.pause()


def connect(endpoint: str) -> None:
    connecting = {"endpoints": [endpoint], "timeout_ms": CONNECT_MS, "exit_on_failure": True}
    try:
        session = zenoh.open(_config({"connect": connecting}))
    except zenoh.ZError as error:
        sys.exit(f"no session: {error}")
    with session, session.declare_publisher("greeting") as publisher:
        listened_to = threading.Event()
        publisher.declare_matching_listener(lambda _: listened_to.set())
        if publisher.matching_status.matching or listened_to.wait(CONNECT_MS / 1000.0):
            publisher.put(GREETING)
        else:
            sys.exit("nobody listens")


def _config(settings: dict[str, object]) -> zenoh.Config:
    return zenoh.Config.from_json5(json.dumps({"mode": "peer", **settings}))


if __name__ == "__main__":
    {"listen": listen, "connect": connect}[sys.argv[1]](sys.argv[2])
