"""The bench's side of a run in processes: it takes what they say until the verdict, and looks after them."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue
from typing import NamedTuple

import structlog
import zenoh

from chassis.refusal import ExitStatus, Refusal
from fleet.inject.process_faults import WORLD, ProcessFaults
from fleet.interruption import Interruption
from fleet.record.recording import KINDS, TOO_MANY, BusMessage, RefusedMind, Restarted, StreamItem
from fleet.run.processes import Processes, Supervisor
from protocol.codec import MessageError, decode
from protocol.keys import Keys
from protocol.messages import Command, Message, Mind, PublicScene, Truth
from protocol.messages import Refusal as Reason
from protocol.session import Opening, SessionSettings, reason_of

MOST_WAITING_BYTES = 8 * 1024 * 1024
"""Of one robot's messages: hundreds of steps. A robot that says more than the bench takes loses its own."""
OVERHEAD_BYTES = 512
"""What a message takes beside its payload, so that empty ones count too."""
LOOK_S = 0.1
"""How often the bench looks after processes and interruptions while nothing arrives."""
LATE_S = 1.0
"""How long a message that the verdict, or the world's end, has overtaken may take."""
SCENE_TIMEOUT_S = 1.0
"""For the world's answer."""

log = structlog.get_logger("bench")


class Received(NamedTuple):
    """A message as it came."""

    key: str
    payload: bytes
    time_ns: int


class Mailbox:
    """Messages come in on any thread and are taken on one, in their order.

    What the world says is never lost. Of each robot's messages a bounded amount waits. The clock that says
    when a message came is the caller's choice.
    """

    def __init__(self, keys: Keys, now_ns: Callable[[], int] = time.time_ns) -> None:
        self._keys, self._now_ns = keys, now_ns
        self._waiting: SimpleQueue[tuple[str | None, Received]] = SimpleQueue()
        self._lock = threading.Lock()
        self._waiting_bytes: Counter[str] = Counter()
        self._lost: Counter[str] = Counter()

    @property
    def lost(self) -> dict[str, int]:
        """How many messages found no room, by robot."""
        with self._lock:
            return dict(self._lost)

    def put(self, sample: zenoh.Sample) -> None:
        """A message has come."""
        received = self._received(str(sample.key_expr), sample)
        sender = None
        if self._keys.kind_of(received.key) in ("command", "mind"):
            sender = self._keys.robot_of(received.key)
            with self._lock:
                if self._waiting_bytes[sender] > MOST_WAITING_BYTES:
                    self._lost[sender] += 1
                    return
                self._waiting_bytes[sender] += len(received.payload) + OVERHEAD_BYTES
        self._waiting.put((sender, received))

    def get(self, timeout_s: float) -> Received:
        """Wait for the next message.

        Raises:
            Empty: none came in time.
        """
        sender, received = self._waiting.get(timeout=timeout_s)
        if sender is not None:
            with self._lock:
                self._waiting_bytes[sender] -= len(received.payload) + OVERHEAD_BYTES
        return received

    def ask_for_scene(self, session: zenoh.Session) -> Received | None:
        """The world's answer; None where there is none yet."""
        replies = session.get(self._keys.scene, timeout=SCENE_TIMEOUT_S)
        answers = (self._received(self._keys.scene, reply.ok) for reply in replies if reply.ok is not None)
        return next(answers, None)

    def _received(self, key: str, sample: zenoh.Sample) -> Received:
        return Received(key, sample.payload.to_bytes(), self._now_ns())


class Decoder:
    """Decodes and checks what comes of a run, in its order.

    A robot may put anything on its command and its mind key, as often as it likes; the bench keeps the first
    valid message of each kind for a step, of the present world, under the robot's own name. Minds that it
    does not keep are counted here; commands are counted by the world, which follows the same rule.
    """

    def __init__(self, keys: Keys) -> None:
        self._keys = keys
        self._epoch: int | None = None
        self._past_epochs: set[int | None] = set()
        self._step = 0
        self._last: dict[str, int] = {}

    def take(self, received: Received) -> BusMessage | RefusedMind | None:
        """The message, if it is to be recorded, or a mind that is not.

        Raises:
            MessageError: the world itself said something that is not valid.
            KeyError: there is no such kind of key.
        """
        key, payload, time_ns = received
        kind = KINDS[self._keys.kind_of(key)]
        if issubclass(kind, Command | Mind):
            robot = self._keys.robot_of(key)
            checked = self._checked(kind, robot, received)
            if isinstance(checked, Message):
                return BusMessage(key, checked, time_ns)
            return RefusedMind(robot, checked) if kind is Mind else None
        message = decode(kind, payload)
        if message.epoch in self._past_epochs:  # it came late: that world is gone
            return None
        if isinstance(message, PublicScene | Truth) and message.epoch != self._epoch:
            self._past_epochs.add(self._epoch)
            self._epoch, self._step = message.epoch, 0
            self._last.clear()
        if isinstance(message, Truth):
            self._step = message.step
        return BusMessage(key, message, time_ns)

    def _checked(self, kind: type[Command | Mind], robot: str, received: Received) -> Command | Mind | Reason:
        try:
            message = decode(kind, received.payload)
        except MessageError:
            return "not a valid message"
        if message.robot != robot:
            return "names another robot"
        if message.epoch != self._epoch:
            return "answers another epoch"
        # The truth of a step comes after its poses, so a quick answer can be here before it.
        if message.step > self._step + 1:
            return "answers another step"
        if message.step <= self._last.get(received.key, -1):
            return "answers a step again"
        self._last[received.key] = message.step
        return message


def obeyed(before: Truth, after: Truth) -> dict[str, int]:
    """By robot, the step whose command led from one truth to the next; without those who missed it."""
    # The verdict on an interrupted step, or the first truth of a world that was started again.
    if after.step == before.step or after.epoch != before.epoch:
        return {}
    return {
        robot: before.step
        for robot, true in after.robots.items()
        if robot in before.robots and true.deadline_misses == before.robots[robot].deadline_misses
    }


class Outstanding:
    """Tells from a run's messages whether commands of the last step are still on their way to the bench.

    A command goes to the world and to the bench at the same time, so the truth that the world makes of it can
    be faster than the command itself.
    """

    def __init__(self) -> None:
        self._answered: dict[str, tuple[int, int]] = {}
        self._truth: Truth | None = None
        self._due: dict[str, tuple[int, int]] = {}

    def add(self, message: Message) -> None:
        """Take a command or a truth; other messages say nothing about it."""
        if isinstance(message, Command):
            self._answered[message.robot] = (message.epoch, message.step)
        elif isinstance(message, Truth):
            steps = {} if self._truth is None else obeyed(self._truth, message)
            self._due = {robot: (message.epoch, step) for robot, step in steps.items()}
            self._truth = message

    def on_their_way(self) -> bool:
        """Whether a command that led to the newest truth has not been taken."""
        return any(self._answered.get(robot) != due for robot, due in self._due.items())


class Subscriber:
    """Listens to a run, and looks after its processes, its faults and interruptions while it waits.

    Callbacks only store; everything else happens where the messages are taken.
    """

    def __init__(
        self,
        run: str,
        processes: Processes,
        supervisor: Supervisor,
        faults: ProcessFaults,
        interruption: Interruption,
    ) -> None:
        self._keys = Keys(run)
        self._processes, self._supervisor, self._faults = processes, supervisor, faults
        self._interruption = interruption
        self._mailbox = Mailbox(self._keys)
        self._decoder = Decoder(self._keys)
        self._outstanding = Outstanding()
        self._begun = False
        self._scene_due = True
        self._world_is_to_end = False

    def connect(self, settings: SessionSettings) -> zenoh.Session:
        """The bench's session, once the world listens.

        Raises:
            Refusal: the world ended instead.
            KeyboardInterrupt: an interruption came before.
        """

        def look() -> None:
            self._hand_on_interruption()
            self._supervisor.look()
            self._give_up_without_processes()

        opening = Opening()
        opening.begin(settings)
        try:
            session = opening.wait(look, every_s=LOOK_S)
        except zenoh.ZError as error:
            sentence = f"the bench cannot reach its world: {reason_of(error)}"
            raise Refusal(sentence, ExitStatus.FAILED) from error
        assert session is not None, "nobody stops this opening"
        return session

    def subscribe(self, session: zenoh.Session) -> Iterator[StreamItem]:
        """Listen to everything, then yield the scene.

        The world's answer shows that it knows of the subscription, which was declared before the question.
        """
        self._session = session
        self._subscriber = session.declare_subscriber(self._keys.everything, self._mailbox.put)
        yield from self._scene()
        while self._scene_due:
            self._give_up_without_processes()
            time.sleep(LOOK_S)
            yield from self._look_after_all()
            yield from self._scene()

    def listen(self) -> Iterator[StreamItem]:
        """Messages up to the truth with the verdict, and those that it has overtaken.

        Raises:
            Refusal: the world, or before the first step a robot, has ended for good; or a robot
                did so later, which is told after the verdict of the others.
            KeyboardInterrupt: an interruption came, and there will be no verdict.
        """
        truth: Truth | None = None
        while truth is None or truth.verdict is None:
            yield from self._look_after_all()
            try:  # what processes said before they ended counts first, and may still be on its way
                received = self._mailbox.get(LATE_S if WORLD in self._supervisor.lost else LOOK_S)
            except Empty:
                self._give_up_without_processes()
                continue
            if self._scene_due:  # whoever speaks can be asked; what it says belongs to that scene
                yield from self._scene()
            for item in self._taken(received):
                yield item
                if isinstance(item, BusMessage) and isinstance(item.message, Truth):
                    _warn_of_gap(truth, item.message)
                    truth, self._begun = item.message, True
                    self._faults.at(truth)
        yield from self._overtaken()
        yield from (RefusedMind(robot, TOO_MANY, count) for robot, count in self._mailbox.lost.items())
        self._supervisor.look()
        if failures := [account for name, account in self._supervisor.lost.items() if name != WORLD]:
            raise Refusal("\n".join(failures), ExitStatus.FAILED)

    def _look_after_all(self) -> Iterator[StreamItem]:
        """Let interruptions, restarts and faults take their course."""
        self._hand_on_interruption()
        self._supervisor.look()
        self._faults.look()
        for name in self._processes.take_started_again():
            if name == WORLD:
                self._begun, self._scene_due = False, True
                self._faults.world_started_again()
            yield Restarted(name)

    def _scene(self) -> Iterator[StreamItem]:
        """The scene, if the world answers already."""
        if (received := self._mailbox.ask_for_scene(self._session)) is not None:
            for item in self._taken(received):
                self._scene_due = False
                yield item

    def _overtaken(self) -> Iterator[StreamItem]:
        """Messages until the last command is there, or none has come for a while."""
        while self._outstanding.on_their_way():
            try:
                yield from self._taken(self._mailbox.get(LATE_S))
            except Empty:
                log.warning("the recording lacks commands of the last step")
                return

    def _taken(self, received: Received) -> Iterator[BusMessage | RefusedMind]:
        """What there is to say of a message, if anything."""
        try:
            item = self._decoder.take(received)
        except (MessageError, KeyError) as error:
            log.warning("not recorded", key=received.key, reason=str(error))
            return
        if isinstance(item, BusMessage):
            self._outstanding.add(item.message)
        if item is not None:
            yield item

    def _give_up_without_processes(self) -> None:
        """End the run where it cannot go on without those who have ended; nothing more waits from them."""
        if self._interruption.requested and not self._processes.is_running(WORLD):
            raise KeyboardInterrupt
        lost = self._supervisor.lost
        if WORLD in lost or (lost and not self._begun):
            if self._interruption.requested:
                raise KeyboardInterrupt
            raise Refusal(lost.get(WORLD) or "\n".join(lost.values()), ExitStatus.FAILED)

    def _hand_on_interruption(self) -> None:
        """The world ends an interrupted run, with its verdict; whoever insists does without one."""
        if self._interruption.insisted:
            raise KeyboardInterrupt
        if self._interruption.requested and not self._world_is_to_end:
            self._world_is_to_end = True
            self._supervisor.give_up_restarting()
            self._processes.ask_to_end(WORLD)


def _warn_of_gap(before: Truth | None, after: Truth) -> None:
    """What the bus has lost is lost for the recording, and not in silence."""
    if before is not None and before.epoch == after.epoch and after.step > before.step + 1:
        log.warning("the recording lacks steps", first=before.step + 1, last=after.step - 1)
