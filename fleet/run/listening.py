"""The bench's ear in a run of processes: it takes what they say until the verdict, and looks after them."""

import threading
import time
from collections import Counter
from collections.abc import Iterator
from queue import Empty, SimpleQueue
from typing import NamedTuple, Protocol

import structlog
import zenoh

from fleet.interruption import Interruption
from fleet.record.stream import KINDS, TOO_MANY, BusMessage, RefusedMind, Restarted, StreamItem
from fleet.run.processes import Processes, ProcessFailedError
from fleet.run.supervisor import WORLD, Supervisor
from protocol.codec import MessageError, decode
from protocol.keys import Keys
from protocol.messages import Command, Message, Mind, PublicScene, Refusal, Truth
from protocol.session import Opening, SessionSettings, reason_of


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
        """Take a command or a truth; other messages tell nothing more."""
        if isinstance(message, Command):
            self._answered[message.robot] = (message.epoch, message.step)
        elif isinstance(message, Truth):
            before, self._truth = self._truth, message
            steps = obeyed(before, message) if before is not None else {}
            self._due = {robot: (message.epoch, step) for robot, step in steps.items()}

    def on_their_way(self) -> bool:
        """Whether a command that led to the newest truth has not been taken."""
        return any(self._answered.get(robot) != due for robot, due in self._due.items())


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


MOST_WAITING_BYTES = 8 * 1024 * 1024
"""Of one robot's messages: hundreds of steps. A robot that says more than the bench takes loses its own."""
OVERHEAD_BYTES = 512
"""What a message takes beside its payload, so that empty ones count too."""


class Received(NamedTuple):
    """A message as it came."""

    key: str
    payload: bytes
    time_ns: int


class Mailbox:
    """Messages come in on any thread and are taken on one, in their order.

    What the world says is never lost. Of each robot's messages a bounded amount waits.
    """

    def __init__(self) -> None:
        self._letters: SimpleQueue[tuple[str | None, Received]] = SimpleQueue()
        self._lock = threading.Lock()
        self._waiting_bytes: Counter[str] = Counter()
        self._lost: Counter[str] = Counter()

    @property
    def lost(self) -> dict[str, int]:
        """How many messages found no room, by robot."""
        with self._lock:
            return dict(self._lost)

    def put(self, sender: str | None, letter: Received) -> None:
        """A message has come; None: from the world."""
        if sender is not None:
            with self._lock:
                if self._waiting_bytes[sender] > MOST_WAITING_BYTES:
                    self._lost[sender] += 1
                    return
                self._waiting_bytes[sender] += _size(letter)
        self._letters.put((sender, letter))

    def get(self, timeout_s: float) -> Received:
        """Wait for the next message.

        Raises:
            Empty: none came in time.
        """
        sender, letter = self._letters.get(timeout=timeout_s)
        if sender is not None:
            with self._lock:
                self._waiting_bytes[sender] -= _size(letter)
        return letter

    def empty(self) -> bool:
        """Whether nothing waits."""
        return self._letters.empty()


def _size(letter: Received) -> int:
    return len(letter.payload) + OVERHEAD_BYTES


class Decoder:
    """Decodes and judges what comes, in its order.

    A robot may put anything on its command and its mind key, as often as it likes; the bench keeps the first
    valid message of each kind for a step, of the present world, under the robot's own name. Of what is not
    taken, minds are told; commands are counted by the world, which takes by the same rule.

    Args:
        keys: of the run.
    """

    def __init__(self, keys: Keys) -> None:
        self._keys = keys
        self._epoch: int | None = None
        self._past_epochs: set[int | None] = set()
        self._step = 0
        self._last: dict[str, int] = {}

    def take(self, letter: Received) -> BusMessage | RefusedMind | None:
        """The message, if it is to be recorded, or a mind that is not.

        Raises:
            MessageError: the world itself said something that is not valid.
        """
        kind = KINDS[self._keys.kind_of(letter.key)]
        if not issubclass(kind, Command | Mind):
            message = decode(kind, letter.payload)
            if message.epoch in self._past_epochs:  # it came late: that world is gone
                return None
            self._follow(message)
            return BusMessage(letter.key, message, letter.time_ns)
        robot = self._keys.robot_of(letter.key)
        judged = self._judge(kind, robot, letter)
        if isinstance(judged, Message):
            return BusMessage(letter.key, judged, letter.time_ns)
        return RefusedMind(robot, judged) if kind is Mind else None

    def _follow(self, message: Message) -> None:
        """The world says which epoch and which step it is."""
        if isinstance(message, PublicScene | Truth) and message.epoch != self._epoch:
            self._past_epochs.add(self._epoch)
            self._epoch = message.epoch
            self._step = 0
            self._last.clear()
        if isinstance(message, Truth):
            self._step = message.step

    def _judge(self, kind: type[Command | Mind], robot: str, letter: Received) -> Command | Mind | Refusal:
        try:
            message = decode(kind, letter.payload)
        except MessageError:
            return "not a valid message"
        if message.robot != robot:
            return "names another robot"
        if message.epoch != self._epoch:
            return "answers another epoch"
        # The truth of a step comes after its poses, so a quick answer can be here before it.
        if message.step > self._step + 1:
            return "answers another step"
        if message.step <= self._last.get(letter.key, -1):
            return "answers a step again"
        self._last[letter.key] = message.step
        return message


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


class Subscriber:
    """The listening side. Callbacks only store; everything else happens where the messages are taken.

    Args:
        run: its name.
        processes: the processes.
        supervisor: says who of them has ended for good.
        director: makes them fail.
        interruption: looked at while waiting.
    """

    def __init__(
        self,
        run: str,
        processes: Processes,
        supervisor: Supervisor,
        director: Directs,
        interruption: Interruption,
    ) -> None:
        self._keys = Keys(run)
        self._processes = processes
        self._supervisor = supervisor
        self._director = director
        self._interruption = interruption
        self._mailbox = Mailbox()
        self._decoder = Decoder(self._keys)
        self._begun = False
        self._scene_due = True
        self._told_to_end = False

    def connect(self, settings: SessionSettings) -> zenoh.Session:
        """The bench's session, once the world listens.

        Raises:
            ProcessFailedError: the world ended instead.
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
            raise ProcessFailedError(f"the bench cannot reach its world: {reason_of(error)}") from error
        assert session is not None, "nobody stops this opening"
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
        stragglers, truth = Outstanding(), None
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
        for name in self._processes.take_started_again():
            if name == WORLD:
                self._begun, self._scene_due = False, True
                self._director.world_started_again()
            yield Restarted(name)

    def _scene(self) -> Iterator[StreamItem]:
        """The scene, if the world answers already."""
        for reply in self._session.get(self._keys.scene, timeout=SCENE_TIMEOUT_S):
            if reply.ok is not None:
                letter = Received(self._keys.scene, reply.ok.payload.to_bytes(), time.time_ns())
                for item in self._taken(letter):
                    self._scene_due = False
                    yield item
                return

    def _take_in(self, stragglers: Outstanding) -> Iterator[StreamItem]:
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
        self._mailbox.put(sender, Received(key, sample.payload.to_bytes(), time.time_ns()))

    def _taken(self, letter: Received) -> Iterator[BusMessage | RefusedMind]:
        """What is to be told of a message, if anything is."""
        try:
            item = self._decoder.take(letter)
        except (MessageError, KeyError) as error:
            log.warning("not recorded", key=letter.key, reason=str(error))
        else:
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
            raise ProcessFailedError(lost.get(WORLD) or "\n".join(lost.values()))

    def _hand_on_interruption(self) -> None:
        """The world ends an interrupted run, with its verdict; whoever insists does without one."""
        if self._interruption.insisted:
            raise KeyboardInterrupt
        if self._interruption.requested and not self._told_to_end:
            self._told_to_end = True
            self._supervisor.give_up_restarting()
            self._processes.ask_to_end(WORLD)


def _tell_gap(before: Truth | None, after: Truth) -> None:
    """What the bus has lost is lost for the recording, and not in silence."""
    if before is not None and before.epoch == after.epoch and after.step > before.step + 1:
        log.warning("the recording lacks steps", first=before.step + 1, last=after.step - 1)
