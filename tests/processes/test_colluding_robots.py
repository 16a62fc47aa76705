"""Two robots of a real run collude in all ways at once: nothing gets through, and nobody drives otherwise."""

import threading

import pytest
import zenoh
from process_helpers import lanes, recorded, write_scenario

from protocol.messages import Command, Truth

MARK = b"psst-1-wants-to-go-left"


def driven(out):
    """What was commanded and what came of it, without the epoch, which every world draws anew."""
    return {
        (key, message.step): message.model_dump(exclude={"epoch", "refused"})
        for key, message in recorded(out)
        if isinstance(message, Command | Truth)
    }


class Colluders:
    """Robots 1 and 2, each with a second session under its own name."""

    def __init__(self, run):
        self.leaked = []
        self._ended = threading.Event()
        keys = run.keys()
        self._one, self._two = run.listening("1"), run.listening("2")
        for session in (self._one, self._two):
            for interest in (
                "**",
                keys.everything,
                keys.pose("3"),
                keys.command("1"),
                keys.mind("1"),
                keys.truth,
            ):
                session.declare_subscriber(interest, self._keep)
            session.liveliness().declare_subscriber("**", self._keep, history=True)
            for key in (keys.scene, keys.scene_for("1"), keys.scene_for("2")):
                session.declare_queryable(key, self._answer)
        self._foreign = (keys.pose("2"), keys.pose("3"), keys.command("3"), keys.truth, "unspoken/secret")
        self._scene = keys.scene_for("2")
        self._talks = threading.Thread(target=self._talk)
        self._talks.start()

    def _keep(self, sample):
        self.leaked.append(str(sample.key_expr))

    def _answer(self, query):
        with query:
            self.leaked.append("a question")
            query.reply(self._scene, MARK)

    def _talk(self):
        while not self._ended.is_set():
            for key in self._foreign:
                # One's own words come back to oneself without the router; the other is to hear them.
                self._one.put(key, MARK, allowed_destination=zenoh.Locality.REMOTE)
                self._one.delete(key, allowed_destination=zenoh.Locality.REMOTE)
            to_all = {"target": zenoh.QueryTarget.ALL, "allowed_destination": zenoh.Locality.REMOTE}
            for reply in self._two.get("**", timeout=0.2, **to_all):
                if reply.ok is not None and MARK in reply.ok.payload.to_bytes():
                    self.leaked.append("an answer")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._talks.join()
        self._one.close()
        self._two.close()


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["--policy", "--no-policy"])
def test_colluding_robots_learn_nothing_and_change_nothing(tmp_path, bench, process, policy):
    scenario = write_scenario(tmp_path / "scenario.yaml", lanes(3, 8.0))
    run = bench("out", "run", scenario, policy)
    with Colluders(run) as colluders:
        status = run.end()
    if policy == "--no-policy":  # or the test would prove nothing
        assert colluders.leaked
        return
    assert status == 0
    assert colluders.leaked == []
    alone = process("alone", "simulate", scenario, "--out", tmp_path / "simulated")
    assert alone.end() == 0
    assert driven(run.out) == driven(tmp_path / "simulated")
