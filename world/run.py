"""A run from the start barrier to the verdict, over any bus."""

import time

from structlog.typing import FilteringBoundLogger

from chassis.process import BEAT_S
from chassis.refusal import ExitStatus, Refusal
from protocol.keys import BENCH_NAME
from protocol.messages import Truth
from world.bus import Arrivals, Bus, Inbox
from world.clock import Clock
from world.health import WorldHealth
from world.judge import Judge, Misses, Versions
from world.world import BaseWorld

RETURN_S = 5.0
"""How long lock-step stands still for the first of them to come back when all have been lost."""


class Run:
    """Steps a world: publish, gather commands, advance, until the referee ends it.

    Each step's observations go out first and its truth second. The last truth carries the verdict. An
    interrupted run repeats the truth of its present step for that, so every truth message but that one has a
    step of its own.

    Args:
        world: not yet advanced.
        clock: how long a step lasts.
        inbox: what arrives from the robots.
        bus: where messages go.
        log: for people.
        health: where it reports how it is; None for one that nobody looks at.
    """

    def __init__(
        self,
        world: BaseWorld,
        clock: Clock,
        inbox: Inbox,
        bus: Bus,
        log: FilteringBoundLogger,
        health: WorldHealth | None = None,
    ) -> None:
        self._health = health or WorldHealth(world.robots)
        self._world = world
        self._clock = clock
        self._inbox = inbox
        self._bus = bus
        self._log = log
        self._judge = Judge(world, log)
        self._misses = Misses(log)
        self._versions = Versions(log)
        self._present: frozenset[str] = frozenset()
        self._interrupted = False
        self._readers: tuple[str, ...] = ()
        self._given_up = False
        self._awaited: set[str] = set()
        self._exhausted: frozenset[str] = frozenset()

    def wait_for_robots(self, timeout_s: float, readers: tuple[str, ...] = ()) -> None:
        """The start barrier: return when every robot of the scenario is present, or on an interruption.

        Args:
            timeout_s: how long at the most.
            readers: who else must be present; in lock-step, steps wait for them to come back, too.

        Raises:
            Refusal: not all of them were present after the time limit.
        """
        self._readers = readers
        awaited = (*self._world.robots, *readers)
        until_s = time.monotonic() + timeout_s
        told = None
        arrivals = self._take(0.0)
        while not arrivals.interrupted and (absent := _absent(awaited, arrivals)):
            missing = ", ".join(absent)
            strangers = ", ".join(sorted(arrivals.present.difference(awaited, (BENCH_NAME,)))) or None
            if told != (missing, strangers):
                self._log.info("waiting for robots", missing=missing, not_in_scenario=strangers)
                self._health.wants(f"it waits for {missing}")
                told = (missing, strangers)
            remaining_s = until_s - time.monotonic()
            if remaining_s <= 0.0:
                raise Refusal(
                    f"not all robots came within {timeout_s:g} s; missing: {missing}. Step 0 was not "
                    f"published.{self._versions.account(absent)} Start the missing robots with the same run "
                    "name and the endpoint of this world, or allow more time with --start-timeout.",
                    ExitStatus.FAILED,
                )
            arrivals = self._take(remaining_s)
        self._present = arrivals.present
        self._interrupted = arrivals.interrupted
        if not self._interrupted:
            self._log.info("all robots present", robots=", ".join(self._world.robots))
            self._health.works(f"drives {len(self._world.robots)} robots")

    def drive(self) -> Truth:
        """Run from step 0 to the end.

        Returns:
            The last truth, with the verdict; it has been published.
        """
        while not self._interrupted and not self._world.over:
            self._begin_step()
            truth = self._truth()
            self._bus.publish_observations(self._world.observations())
            self._bus.publish_truth(truth)
            self._health.stepped(truth, self._clock.overruns)
            self._gather()
            if not self._interrupted:
                self._misses.add(robot for robot in self._world.present if self._has_missed(robot))
                self._world.advance(self._judge.answers)
        self._world.interrupt()
        truth = self._truth()
        self._bus.publish_truth(truth)
        self._health.stepped(truth, self._clock.overruns)
        self._misses.tell()
        self._log.info(
            "run ended",
            verdict=truth.verdict,
            step=truth.step,
            time_s=round(truth.time_s, 6),
            refused_commands=self._judge.refused,
            overruns=self._clock.overruns,
        )
        return truth

    def _has_missed(self, robot: str) -> bool:
        answer = self._judge.answers.get(robot)
        return answer is None or answer.withheld

    def _truth(self) -> Truth:
        return self._world.truth(self._judge.refused)

    def _begin_step(self) -> None:
        """Await the robots that are present before the step is published, and no others.

        A robot that comes later may have missed the observation and cannot be expected to answer it.
        """
        self._judge.begin_step()
        self._awaited = set()
        self._inbox.begin_step()
        self._receive(0.0)
        if self._clock.waits_for_all:
            self._wait_for_company()
        self._awaited = set(self._present.intersection(self._world.present))
        self._clock.begin_step()

    def _wait_for_company(self) -> None:
        """Stand still while nobody would see the step: a run without robots, or unread, rushes to its end."""
        until_s = time.monotonic() + RETURN_S
        while self._is_alone() and not self._given_up and not self._interrupted:
            remaining_s = until_s - time.monotonic()
            self._given_up = remaining_s <= 0.0
            self._receive(remaining_s)
        self._given_up = self._given_up and self._is_alone()

    def _is_alone(self) -> bool:
        expected = self._world.present
        robots_lost = bool(expected) and self._present.isdisjoint(expected)
        return robots_lost or not self._present.issuperset(self._readers)

    def _gather(self) -> None:
        """Collect the step's commands until the clock, or the last awaited answer, ends it.

        A robot that has said all that it may is not awaited.
        """
        self._receive(0.0)
        while not self._interrupted and (remaining_s := self._clock.remaining_s()) > 0.0:
            if self._clock.waits_for_all and self._awaited <= self._judge.answers.keys() | self._exhausted:
                return
            self._receive(remaining_s)

    def _take(self, timeout_s: float) -> Arrivals:
        """News, or empty hands after this time or sooner; a sign of life each time.

        Who has asked for the scene in another version of the protocol is told at once.
        """
        self._health.beat()
        arrivals = self._inbox.take(min(timeout_s, BEAT_S))
        self._versions.hear(arrivals.questions)
        self._health.present = arrivals.present
        return arrivals

    def _receive(self, timeout_s: float) -> None:
        arrivals = self._take(timeout_s)
        self._interrupted = arrivals.interrupted
        self._awaited -= arrivals.gone
        self._exhausted = arrivals.exhausted
        self._tell_presence(arrivals)
        for robot, payload in arrivals.commands:
            self._judge.judge(robot, payload)
        self._health.answered(self._judge.answers)

    def _tell_presence(self, arrivals: Arrivals) -> None:
        for robot in self._world.robots:
            if robot in self._present and robot in arrivals.gone | (self._present - arrivals.present):
                self._log.warning("robot lost", robot=robot, step=self._world.step)
            if robot in arrivals.present and robot in arrivals.gone | (arrivals.present - self._present):
                self._log.info("robot returned", robot=robot, step=self._world.step)
        self._present = arrivals.present


def _absent(awaited: tuple[str, ...], arrivals: Arrivals) -> list[str]:
    return [name for name in awaited if name not in arrivals.present]
