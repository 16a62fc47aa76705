"""Who may say and read what: the whole policy of a run, and how Zenoh's router is told to enforce it.

Everything that is not granted here is denied: reading, putting, deleting, declaring an interest, answering
queries, asking them, and being present under another name.
"""

from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple

from pydantic import BaseModel, ConfigDict

from protocol.keys import BENCH_NAME, Keys

Proof = Literal["usernames", "cert_common_names"]
"""What tells Zenoh who is at the other end: the name that goes with a password, or that of a certificate."""


class Rights(NamedTuple):
    """Keys by what one participant may do with them."""

    reads: tuple[str, ...]
    """It may subscribe to them and is sent what is put there."""
    says: tuple[str, ...]
    """It may put there."""
    readers: tuple[str, ...]
    """Subscriptions of others that it is told of: Zenoh sends nothing for which it knows no reader."""
    asks: tuple[str, ...]
    """It may ask a queryable there, and is answered."""
    stands: tuple[str, ...]
    """Its liveliness tokens."""
    sees: tuple[str, ...] = ()
    """Liveliness tokens of others that it may know of."""


def rights_of(keys: Keys, robots: Iterable[str]) -> dict[str, Rights]:
    """The rights of each robot and of the bench, by name; the world is the router and has all of them."""
    rights = {
        robot: Rights(
            reads=(keys.pose(robot),),
            says=(keys.command(robot), keys.mind(robot)),
            readers=(keys.command(robot), keys.everything),  # those of the world and of the bench
            asks=(keys.scene_for(robot),),
            stands=(keys.alive(robot),),
        )
        for robot in robots
    }
    bench = Rights(
        reads=(keys.everything,),
        says=(),
        readers=(),
        asks=(keys.scene,),
        stands=(),
        sees=(keys.everyone_alive,),
    )
    return rights | {BENCH_NAME: bench}


class _Zenoh(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Rule(_Zenoh):
    """What may pass between the router and a subject, on some keys and in one direction."""

    id: str
    messages: tuple[str, ...]
    flows: tuple[Literal["ingress", "egress"]]
    """As the router sees it: ingress comes from the subject."""
    permission: Literal["allow"] = "allow"
    key_exprs: tuple[str, ...]


class Subject(_Zenoh):
    """One participant, by what proves its name."""

    id: str
    usernames: tuple[str, ...] | None = None
    cert_common_names: tuple[str, ...] | None = None


class Grant(_Zenoh):
    """Which rules hold for which subjects."""

    rules: tuple[str, ...]
    subjects: tuple[str, ...]


class AccessControl(_Zenoh):
    """Zenoh's ``access_control``."""

    enabled: Literal[True] = True
    default_permission: Literal["deny"] = "deny"
    rules: tuple[Rule, ...]
    subjects: tuple[Subject, ...]
    policies: tuple[Grant, ...]


def access_control(rights: Mapping[str, Rights], proof: Proof) -> AccessControl:
    """The rights as rules for Zenoh's router.

    Args:
        rights: by name.
        proof: what proves a name.
    """
    rules = {name: tuple(_rules(name, granted)) for name, granted in rights.items()}
    return AccessControl(
        rules=tuple(rule for of_one in rules.values() for rule in of_one),
        subjects=tuple(Subject(id=name, **{proof: (name,)}) for name in rights),
        policies=tuple(
            Grant(rules=tuple(rule.id for rule in of_one), subjects=(name,)) for name, of_one in rules.items()
        ),
    )


_MEANING: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "reads": (("declare_subscriber",), ("put",)),
    "says": (("put",), ()),
    "readers": ((), ("declare_subscriber",)),
    "asks": (("query",), ("reply", "declare_queryable")),
    "stands": (("liveliness_token",), ()),
    "sees": (("declare_liveliness_subscriber", "liveliness_query"), ("liveliness_token",)),
}
"""By right: the messages that may come in from whoever has it, and those that may go out to it."""


def _rules(name: str, granted: Rights) -> Iterable[Rule]:
    for right, (comes, goes) in _MEANING.items():
        keys = getattr(granted, right)
        if keys and comes:
            yield Rule(id=f"{name} {right} in", messages=comes, flows=("ingress",), key_exprs=keys)
        if keys and goes:
            yield Rule(id=f"{name} {right} out", messages=goes, flows=("egress",), key_exprs=keys)
