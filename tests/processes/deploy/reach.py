"""``python -c`` of this in a container: which of the named hosts answer at all; a refusal is an answer."""

import socket
import sys
from concurrent.futures import ThreadPoolExecutor

PORT = 7448
LONGEST_S = 5.0


def is_reached(host: str) -> bool:
    """Whether the host is known and anything comes back from it."""
    try:
        with socket.create_connection((host, PORT), timeout=LONGEST_S):
            return True
    except ConnectionRefusedError:
        return True
    except OSError:
        return False


if __name__ == "__main__":
    hosts = sys.argv[1:]
    with ThreadPoolExecutor(len(hosts)) as threads:
        for host, reached in zip(hosts, threads.map(is_reached, hosts), strict=True):
            if reached:
                print(host)
