"""Signals as a wish to end, in a real process that waits on a queue."""

import signal
import subprocess
import sys

import pytest

WAITING = """
import queue, sys
from chassis.process import on_wish_to_end
inbox = queue.SimpleQueue()
on_wish_to_end(lambda: inbox.put("end"))
print("waiting", flush=True)
print(inbox.get(), flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_wait_of_the_main_thread(number):
    with subprocess.Popen([sys.executable, "-c", WAITING], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "waiting\n"
            process.send_signal(number)
            assert process.communicate(timeout=60)[0] == "end\n"
        finally:
            process.kill()
    assert process.returncode == 0
