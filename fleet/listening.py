"""The bench's ear in a run of processes: it takes what they say until the verdict, and looks after them."""

import time
from collections.abc import Iterator
from queue import Empty, SimpleQueue
from typing import Protocol

import structlog
import zenoh

from fleet.crew import Crew, ProcessFailedError
from fleet.intake import Intake
from fleet.interruption import Interruption
from fleet.mailbox import Letter, Mailbox
from fleet.stragglers import Stragglers
from fleet.stream import TOO_MANY, BusMessage, RefusedMind, Restarted, StreamItem
from fleet.supervision import WORLD, Supervisor
from protocol.codec import MessageError
from protocol.keys import Keys
from protocol.messages import Truth
from protocol.session import SessionSettings, open_in_background, reason_of

LOOK_S = 0.1
"""How often the bench looks after processes and interruptions while nothing arrives."""

STRAGGLERS_S = 1.0
"""How long a message that the verdict, or the world's end, has overtaken may take."""

SCENE_TIMEOUT_S = 1.0
"""For the world's answer."""

SAID_BY_ROBOTS = ("command", "mind")

log = structlog.get_logger("bench")


class Directs(Protocol):
    """Makes processes fail."""

    def at(self, truth: Truth) -> None:
        """The world has come to this step."""

    def look(self) -> None:
        """Do what is due by the wall clock."""

    def world_started_again(self) -> None:
        """A new epoch begins."""


class Bench:
    """The listening side. Callbacks only store; everything else happens where the messages are taken.

    Args:
        run: its name.
        crew: the processes.
        supervisor: says who of them has ended for good.
        director: makes them fail.
        interruption: looked at while waiting.
    """

    def __init__(
        self, run: str, crew: Crew, supervisor: Supervisor, director: Directs, interruption: Interruption
    ) -> None:
        self._keys = Keys(run)
        self._crew = crew
        self._supervisor = supervisor
        self._director = director
        self._interruption = interruption
        self._mailbox = Mailbox()
        self._intake = Intake(self._keys)
        self._begun = False
        self._scene_due = True
        self._told_to_end = False

    def connect(self, settings: SessionSettings) -> zenoh.Session:
        """The bench's session, once the world listens.

        Raises:
            ProcessFailedError: the world ended instead.
        """
        opened: SimpleQueue[zenoh.Session | zenoh.ZError] = SimpleQueue()
        open_in_background(settings, opened.put)
        while True:
            try:
                session = opened.get(timeout=LOOK_S)
            except Empty:
                self._hand_on_interruption()
                self._supervisor.look()
                self._give_up_without_processes()
                continue
            if isinstance(session, zenoh.ZError):
                raise ProcessFailedError(f"the bench cannot reach its world: {reason_of(session)}")
            return session

    def subscribe(self, session: zenoh.Session) -> Iterator[StreamItem]:
        """Listen to everything, then yield the scene.

        The world's answer shows that it knows of the subscription, which was declared before the question.
        """
        self._session = session
        self._subscriber = session.declare_subscriber(self._keys.everything, self._store)
        yield from self._scene()
        while self._scene_due:
            self._give_up_without_processes()
            time.sleep(LOOK_S)
            yield from self._look_after_all()
            yield from self._scene()

    def listen(self) -> Iterator[StreamItem]:
        """Messages up to the truth with the verdict, and those that it has overtaken."""
        stragglers, truth = Stragglers(), None
        while truth is None or truth.verdict is None:
            yield from self._look_after_all()
            try:  # what processes said before they ended counts first, and may still be on its way
                letter = self._mailbox.get(STRAGGLERS_S if WORLD in self._supervisor.lost else LOOK_S)
            except Empty:
                self._give_up_without_processes()
                continue
            if self._scene_due:  # whoever speaks can be asked; what it says belongs to that scene
                yield from self._scene()
            for item in self._taken(letter):
                yield item
                if isinstance(item, BusMessage):
                    stragglers.add(item.message)
                    if isinstance(item.message, Truth):
                        self._begun = True
                        _tell_gap(truth, item.message)
                        truth = item.message
                        self._director.at(truth)
        yield from self._take_in(stragglers)
        yield from (RefusedMind(robot, TOO_MANY, count) for robot, count in self._mailbox.lost.items())
        self._supervisor.look()
        failures = [account for name, account in self._supervisor.lost.items() if name != WORLD]
        if failures:
            raise ProcessFailedError("\n".join(failures))

    def _look_after_all(self) -> Iterator[StreamItem]:
        """Let interruptions, restarts and faults take their course."""
        self._hand_on_interruption()
        self._supervisor.look()
        self._director.look()
        for name in self._crew.take_started_again():
            if name == WORLD:
                self._begun, self._scene_due = False, True
                self._director.world_started_again()
            yield Restarted(name)

    def _scene(self) -> Iterator[StreamItem]:
        """The scene, if the world answers already."""
        for reply in self._session.get(self._keys.scene, timeout=SCENE_TIMEOUT_S):
            if reply.ok is not None:
                letter = Letter(self._keys.scene, reply.ok.payload.to_bytes(), time.time_ns())
                for item in self._taken(letter):
                    self._scene_due = False
                    yield item
                return

    def _take_in(self, stragglers: Stragglers) -> Iterator[StreamItem]:
        """Messages until the last command is there, or none has come for a while."""
        while stragglers.on_their_way():
            try:
                letter = self._mailbox.get(STRAGGLERS_S)
            except Empty:
                log.warning("the recording lacks commands of the last step")
                return
            for item in self._taken(letter):
                if isinstance(item, BusMessage):
                    stragglers.add(item.message)
                yield item

    def _store(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        sender = self._keys.robot_of(key) if self._keys.kind_of(key) in SAID_BY_ROBOTS else None
        self._mailbox.put(sender, Letter(key, sample.payload.to_bytes(), time.time_ns()))

    def _taken(self, letter: Letter) -> Iterator[BusMessage | RefusedMind]:
        """What is to be told of a message, if anything is."""
        try:
            item = self._intake.take(letter)
        except (MessageError, KeyError) as error:
            log.warning("not recorded", key=letter.key, reason=str(error))
        else:
            if item is not None:
                yield item

    def _give_up_without_processes(self) -> None:
        """End the run where it cannot go on without those who have ended; nothing more waits from them."""
        if self._interruption.requested and not self._crew.is_running(WORLD):
            raise KeyboardInterrupt
        lost = self._supervisor.lost
        if WORLD in lost or (lost and not self._begun):
            if self._interruption.requested:
                raise KeyboardInterrupt
            raise ProcessFailedError(lost.get(WORLD) or "\n".join(lost.values()))

    def _hand_on_interruption(self) -> None:
        """The world ends an interrupted run, with its verdict; whoever insists does without one."""
        if self._interruption.insisted:
            raise KeyboardInterrupt
        if self._interruption.requested and not self._told_to_end:
            self._told_to_end = True
            self._supervisor.give_up_restarting()
            self._crew.ask_to_end(WORLD)


def _tell_gap(before: Truth | None, after: Truth) -> None:
    """What the bus has lost is lost for the recording, and not in silence."""
    if before is not None and before.epoch == after.epoch and after.step > before.step + 1:
        log.warning("the recording lacks steps", first=before.step + 1, last=after.step - 1)
