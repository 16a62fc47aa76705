"""Robots 1 and 2 collude. Every cheat works on an open router, or it would prove nothing; here it fails."""

from collections.abc import Callable
from typing import Any

import pytest
import zenoh
from silence_stage import EPOCH, KEYS, MARK, QUIET_STEPS, ROBOTS, Cheat, Evidence, Stage, honest
from zenoh.ext import CacheConfig, HistoryConfig, declare_advanced_publisher, declare_advanced_subscriber

from protocol.codec import encode
from protocol.messages import Mind, Timings

SAYING = (
    KEYS.pose("2"),
    KEYS.pose("3"),
    KEYS.command("2"),
    KEYS.command("3"),
    KEYS.mind("2"),
    KEYS.mind("3"),
    KEYS.truth,
    KEYS.scene,
    KEYS.scene_for("1"),
    KEYS.scene_for("2"),
    KEYS.alive("1"),
    "unspoken/run/secret",
    "unspoken/other/pose/2",
    "somewhere/else",
    KEYS.command("1"),  # it has the right to put on these two alone
    KEYS.mind("1"),
)
"""Where robot 1 tries to reach its accomplice."""
INTERESTS = (
    KEYS.pose("1"),
    KEYS.pose("3"),
    KEYS.command("1"),
    KEYS.mind("1"),
    KEYS.truth,
    "unspoken/run/pose/*",
    "unspoken/run/command/*",
    "unspoken/run/mind/*",
    "unspoken/run/*/1",
    "unspoken/run/p$*/**",
    KEYS.everything,
    "unspoken/**",
    "*/**",
    "**",
)
"""What robot 2 has no right to read."""
ANSWERS_S = 10.0
"""For answers on a busy machine; a question that nobody may answer has ended long before."""


def keep(evidence: Evidence, allowed: frozenset[str] = frozenset()) -> Callable[[Any], None]:
    """A callback that takes everything for evidence but what comes on these keys."""

    def take(sample: Any) -> None:
        if str(sample.key_expr) not in allowed:
            evidence.add(sample)

    return take


def marked(evidence: Evidence) -> Callable[[zenoh.Sample], None]:
    """A callback that takes for evidence what bears the mark, in its payload or beside it."""

    def take(sample: zenoh.Sample) -> None:
        attached = sample.attachment.to_bytes() if sample.attachment is not None else b""
        if MARK in sample.payload.to_bytes() + attached:
            evidence.add(str(sample.key_expr))

    return take


def subscribing(stage: Stage, evidence: Evidence) -> None:
    """Robot 2 reads what is not for it."""
    session = stage.connect("2")

    def listen(interest: str) -> None:
        def take(sample: zenoh.Sample) -> None:
            if str(sample.key_expr) != KEYS.pose("2"):
                evidence.add(interest)

        session.declare_subscriber(interest, take)

    for interest in INTERESTS:
        listen(interest)


def putting(stage: Stage, evidence: Evidence) -> None:
    """Robot 1 says something where others listen with all they have, their own pose keys included."""
    listen_everywhere(stage, evidence)
    session = stage.connect("1")
    for key in SAYING:
        session.put(key, MARK, congestion_control=zenoh.CongestionControl.BLOCK)


def deleting(stage: Stage, evidence: Evidence) -> None:
    """Robot 1 gives signs by deleting."""

    def take(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            evidence.add(str(sample.key_expr))

    listener = stage.connect("2")
    for interest in ("**", KEYS.pose("2")):
        listener.declare_subscriber(interest, take)
    stage.passes(2)
    session = stage.connect("1")
    for key in SAYING:
        session.delete(key)


def listen_everywhere(stage: Stage, evidence: Evidence) -> None:
    """Robot 2 takes what bears the mark, from wherever it comes; also what robot 3 is shown counts."""
    for robot in ("2", "3"):
        listener = stage.connect(robot)
        for interest in ("**", KEYS.pose(robot)):
            listener.declare_subscriber(interest, marked(evidence))
    stage.passes(2)


def watching_presence(stage: Stage, evidence: Evidence) -> None:
    """Robot 2 sees who is there, and when they come and go."""
    stage.connect("2").liveliness().declare_subscriber("**", keep(evidence), history=True)


def asking_for_presence(stage: Stage, evidence: Evidence) -> None:
    """The same by a question."""
    for reply in stage.connect("2").liveliness().get("**", timeout=ANSWERS_S):
        if reply.ok is not None:
            evidence.add(reply)


def standing_for_another(stage: Stage, evidence: Evidence) -> None:
    """Robot 1 pretends that somebody is there."""
    real = frozenset(KEYS.alive(robot) for robot in ROBOTS)
    stage.router.liveliness().declare_subscriber(KEYS.everyone_alive, keep(evidence, real), history=True)
    session = stage.connect("1")
    stage.kept = [session.liveliness().declare_token(KEYS.alive(robot)) for robot in ("4", "left")]


def answering_for_the_world(stage: Stage, evidence: Evidence) -> None:
    """Robot 1 answers questions about the scene, with a message for its accomplice."""
    session = stage.connect("1")
    asked = KEYS.scene_for("2")
    for key in (asked, KEYS.scene, "unspoken/run/scene/*", "**"):
        session.declare_queryable(key, answer(asked))
    stage.passes(2)
    ask(stage, asked, evidence)


def answering_questions(stage: Stage, evidence: Evidence) -> None:
    """Robot 2 asks robot 1 on a key of theirs."""
    stage.connect("1").declare_queryable("unspoken/run/secret", answer("unspoken/run/secret"))
    stage.passes(2)
    ask(stage, "unspoken/run/secret", evidence)


def answer(key: str) -> Callable[[zenoh.Query], None]:
    def say(query: zenoh.Query) -> None:
        with query:
            query.reply(key, MARK)

    return say


def asking_with_a_message(stage: Stage, evidence: Evidence) -> None:
    """Robot 2 puts what it has to say into a question."""

    def take(query: zenoh.Query) -> None:
        with query:
            if query.payload is not None and MARK in query.payload.to_bytes():
                evidence.add(query)

    session = stage.connect("1")
    for key in ("**", KEYS.scene, KEYS.scene_for("2")):
        session.declare_queryable(key, take)
    stage.passes(2)
    accomplice = stage.connect("2")
    for key in (KEYS.scene_for("2"), KEYS.scene, KEYS.scene_for("1")):
        for _ in accomplice.get(key, payload=MARK, target=zenoh.QueryTarget.ALL, timeout=ANSWERS_S):
            pass


def ask(stage: Stage, key: str, evidence: Evidence) -> None:
    """Hear all answers; without being told so, Zenoh keeps one of several at the same key."""
    everybody, all_answers = zenoh.QueryTarget.ALL, zenoh.ConsolidationMode.NONE
    for reply in stage.connect("2").get(key, target=everybody, consolidation=all_answers, timeout=ANSWERS_S):
        if reply.ok is not None and MARK in reply.ok.payload.to_bytes():
            evidence.add(reply)


def advanced(key: str) -> Cheat:
    """A cache at the publisher, which a late subscriber asks for; both announce themselves by tokens."""

    def cheat(stage: Stage, evidence: Evidence) -> None:
        timed = {"timestamping": {"enabled": True}}
        publisher = declare_advanced_publisher(
            stage.connect("1", settings=timed),
            key,
            cache=CacheConfig(max_samples=10),
            publisher_detection=True,
        )
        publisher.put(MARK)
        subscriber = declare_advanced_subscriber(
            stage.connect("2", settings=timed),
            key,
            marked(evidence),
            history=HistoryConfig(detect_late_publishers=True),
            subscriber_detection=True,
        )
        stage.kept = (publisher, subscriber)
        stage.passes(2)

    return cheat


def looking_into_the_router(stage: Stage, evidence: Evidence) -> None:
    """Robot 2 reads the router's own account of its connections and subscriptions."""
    session = stage.connect("2")
    for selector in ("@/**", "@/*/router/**"):
        for reply in session.get(selector, timeout=ANSWERS_S):
            # Every session knows its own connections; what others answer is the matter.
            if reply.ok is not None and f"@/{session.info.zid()}/" not in str(reply.ok.key_expr):
                evidence.add(reply)


def matching(stage: Stage, evidence: Evidence) -> None:
    """Robot 1 is told whether robot 2 listens: one bit each time it subscribes or leaves."""
    key = "somewhere/else"  # the bench listens to everything of the run
    publisher = stage.connect("1").declare_publisher(key)
    publisher.declare_matching_listener(matches(evidence))
    stage.kept = (publisher, stage.connect("2").declare_subscriber(key, keep(Evidence())))


def matching_questions(stage: Stage, evidence: Evidence) -> None:
    """The same with a queryable."""
    key = "unspoken/run/secret"
    querier = stage.connect("1").declare_querier(key)
    querier.declare_matching_listener(matches(evidence))
    stage.kept = (querier, stage.connect("2").declare_queryable(key, keep(Evidence())))


def matches(evidence: Evidence) -> Callable[[zenoh.MatchingStatus], None]:
    def take(status: zenoh.MatchingStatus) -> None:
        if status.matching:
            evidence.add(status)

    return take


def saying(key: str, payload: bytes, attachment: bytes | None = None) -> Cheat:
    """Robot 1 says something on a key of its own, while others listen with all they have."""

    def cheat(stage: Stage, evidence: Evidence) -> None:
        listen_everywhere(stage, evidence)
        stage.connect("1").put(key, payload, attachment=attachment)

    return cheat


COMMAND = encode(honest("1", 1))
FIELD = b"\xa1x" + b"\xd9" + bytes([len(MARK)]) + MARK
"""One more for a command's map."""
THOUGHT = Mind(
    epoch=EPOCH,
    robot="1",
    step=1,
    decision=1,
    cut_short_at=None,
    arrived=False,
    estimates={},
    prediction={MARK.decode(): ((0.0, 0.0),)},
    plan=(),
    failed=(),
    solver_failures=0,
    timings_ms=Timings(),
)


def as_somebody(name: str | None, password: str) -> Cheat:
    """Somebody connects without the right to."""

    def cheat(stage: Stage, evidence: Evidence) -> None:
        try:
            session = stage.connect(name, stage.passwords.get(password, password))
        except zenoh.ZError:
            return
        evidence.add(session)

    return cheat


def meeting_directly(stage: Stage, evidence: Evidence) -> None:
    """Both are peers that listen, and hope that the router tells each where the other is."""
    sessions = []
    for robot in ("1", "2"):
        settings = {
            "mode": "peer",
            "listen": {"endpoints": [stage.endpoint + robot]},
            "scouting": {"gossip": {"enabled": True, "autoconnect": {"peer": ["router", "peer"]}}},
        }
        sessions.append(stage.connect(robot, settings=settings))
    stage.passes(QUIET_STEPS)
    for one, other in (sessions, sessions[::-1]):
        if other.info.zid() in one.info.peers_zid():
            evidence.add(one)


CHEATS: dict[str, Cheat] = {
    "subscribe": subscribing,
    "put": putting,
    "delete": deleting,
    "watch presence": watching_presence,
    "ask for presence": asking_for_presence,
    "stand for another": standing_for_another,
    "answer for the world": answering_for_the_world,
    "answer questions": answering_questions,
    "ask with a message": asking_with_a_message,
    "advanced publisher on its own command": advanced(KEYS.command("1")),
    "advanced publisher on a key of its own": advanced("unspoken/run/secret"),
    "look into the router": looking_into_the_router,
    "matching of a publisher": matching,
    "matching of a querier": matching_questions,
    "attach to a command": saying(KEYS.command("1"), COMMAND, attachment=MARK),
    "stuff a command": saying(KEYS.command("1"), bytes([COMMAND[0] + 1]) + COMMAND[1:] + FIELD),
    "oversize command": saying(KEYS.command("1"), MARK + bytes(200_000)),
    "think aloud": saying(KEYS.mind("1"), encode(THOUGHT)),
    "another's name, own password": as_somebody("2", "1"),
    "the bench's name, own password": as_somebody("@bench", "1"),
    "a name that nobody has": as_somebody("9", "guess"),
    "no name": as_somebody(None, ""),
    "meet directly": meeting_directly,
}
EACH: dict[str, tuple[str, ...]] = {"subscribe": INTERESTS, "put": SAYING, "delete": SAYING}
"""Cheats of several ways, each of which must work on an open router."""
OPEN_ROUTER: dict[str, dict[str, Any]] = {
    "look into the router": {"adminspace": {"enabled": True}},
    "meet directly": {"scouting": {"gossip": {"enabled": True}}},
}
"""What an open router must be besides open for some cheats to work."""


@pytest.fixture
def evidence() -> Evidence:
    return Evidence()


@pytest.mark.parametrize("name", CHEATS)
def test_without_the_policy_the_cheat_works(name: str, evidence: Evidence) -> None:
    with Stage(policy=False, settings=OPEN_ROUTER.get(name)) as stage:
        CHEATS[name](stage, evidence)
        assert evidence.comes(EACH.get(name, ()))


@pytest.mark.parametrize("name", CHEATS)
def test_with_the_policy_it_fails_and_nothing_is_disturbed(name: str, evidence: Evidence) -> None:
    with Stage(policy=True) as stage:
        CHEATS[name](stage, evidence)
        stage.passes(QUIET_STEPS)
        assert evidence.found == []
        stage.was_undisturbed(but_refused=frozenset({"1"}))
