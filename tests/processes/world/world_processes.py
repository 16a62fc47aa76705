"""A real world process, scripted robots and a truth recorder, each on a session of its own."""

import subprocess
import sys
import threading

import yaml
import zenoh
from world_helpers import KEYS, PATIENCE_S, command, sprint

from protocol.codec import decode, encode
from protocol.messages import Observation, Truth
from protocol.session import client_session


def connect(endpoint):
    """A client's session that gives up when no world comes: a failing test must not hang."""
    return zenoh.open(client_session(endpoint, patience_s=PATIENCE_S).to_zenoh())


def write_scenario(path, scenario):
    """Save a scenario of the tests as a file."""
    path.write_text(yaml.safe_dump(scenario.model_dump(mode="json", exclude_none=True)))
    return path


class WorldProcess:
    """``python -m world``, with its log lines to wait for."""

    def __init__(self, *arguments, env=None):
        self._process = subprocess.Popen(
            [sys.executable, "-m", "world", *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=env,
        )
        self._lines = []
        self._more = threading.Condition()
        self._closed = False
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self):
        for line in self._process.stdout:
            with self._more:
                self._lines.append(line)
                self._more.notify_all()
        with self._more:
            self._closed = True
            self._more.notify_all()

    @property
    def log(self):
        with self._more:
            return "".join(self._lines)

    def wait_for(self, text):
        """Until a log line with this text has come."""
        with self._more:
            self._more.wait_for(lambda: self._closed or any(text in line for line in self._lines), PATIENCE_S)
        assert text in self.log, self.log

    def signal(self, number):
        self._process.send_signal(number)

    def end(self):
        """Wait for the end; exit status and what stands on stderr."""
        status = self._process.wait(PATIENCE_S)
        self._reader.join()
        return status, self._process.stderr.read()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.kill()
        self._process.wait()
        self._reader.join()
        self._process.stdout.close()
        self._process.stderr.close()


class Robot:
    """Answers every observation with its sprint. `before` and `silent_from` make it misbehave."""

    def __init__(self, endpoint, name, *, silent_from=None, before=lambda session, seen: None):
        self.name = name
        self.seen = []
        self._silent_from = silent_from
        self._before = before
        self.session = connect(endpoint)
        self._commands = self.session.declare_publisher(KEYS.command(name))
        self._poses = self.session.declare_subscriber(KEYS.pose(name), self._answer)
        self._token = self.session.liveliness().declare_token(KEYS.alive(name))

    def _answer(self, sample):
        seen = decode(Observation, sample.payload.to_bytes())
        self.seen.append(seen)
        self._before(self.session, seen)
        if self._silent_from is None or seen.step < self._silent_from:
            answer = command(self.name, seen.step, sprint(seen.step), epoch=seen.epoch)
            self._commands.put(encode(answer))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.session.close()


class TruthRecorder:
    """Keeps every truth; `reached` waits for a step and `ended` for the verdict."""

    def __init__(self, endpoint):
        self.truths = []
        self._more = threading.Condition()
        self._session = connect(endpoint)
        self._subscriber = self._session.declare_subscriber(KEYS.truth, self._keep)

    def _keep(self, sample):
        truth = decode(Truth, sample.payload.to_bytes())
        with self._more:
            self.truths.append(truth)
            self._more.notify_all()

    def reached(self, step):
        with self._more:
            found = self._more.wait_for(lambda: self.truths and self.truths[-1].step >= step, PATIENCE_S)
        assert found, f"step {step} was not reached"

    def ended(self):
        """The last truth; after it this reader leaves, for which the world waits."""
        with self._more:
            found = self._more.wait_for(lambda: self.truths and self.truths[-1].verdict, PATIENCE_S)
        assert found, "no truth with a verdict came"
        self._subscriber.undeclare()
        return self.truths[-1]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._session.close()
