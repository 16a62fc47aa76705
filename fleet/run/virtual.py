"""A run in virtual time: the one loop of world and robots, and the messages that processes would exchange.

Faults of links and minds count steps of the present epoch, as observations tell them. Faults of processes
happen once in a run: they count steps since the first start of the world. A robot that is down is one that
nothing reaches. How long the world is down has no meaning here, since nobody waits.
"""

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import count
from typing import NamedTuple

import structlog

from agent.agent import Decision
from agent.process.inbox import Inbox
from agent.process.robot import Decides
from agent.process.warm import warm_up
from agent.solve import Clock
from fleet.inject.fault import Fault, Scheduled, of_kind, schedule
from fleet.inject.link import LINK_FAULTS, Link
from fleet.inject.mind import MIND_FAULTS, FaultyMind
from fleet.inject.process_faults import DownFault, RestartWorld
from fleet.inject.scenario import Scenario, effective
from fleet.interruption import Interruption, compile_solver
from fleet.record.experiment import Experiment, RunFacts
from fleet.record.recording import BusMessage
from protocol.codec import encode
from protocol.keys import Keys
from protocol.messages import Command, Observation, PublicScene, Truth
from protocol.scenario import ScenarioRobot
from protocol.scene import Scene
from world.judge import Judge
from world.world import World

EPOCH = 0
"""Of the first world; what it says depends on nothing but the run."""
SILENT = structlog.wrap_logger(None, wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
"""In virtual time, what is refused is counted, or shows in what does not happen; there is no log of it."""


class Step(NamedTuple):
    """One step of a run: how things stand, what each robot is shown of them, and what comes of it."""

    truth: Truth
    observations: Mapping[str, Observation]
    """As the world gives them; faults may let something else reach a robot."""
    decisions: Mapping[str, Decision]
    """Of the robots that made one; in the last step nobody does."""
    commands: Mapping[str, tuple[Command, ...]]
    """What reached the world from each robot, taken or not; with faults, this may not be what was decided."""


def closed_loop(
    scenario: Scenario, facts: RunFacts, clock: Clock, interrupted: Callable[[], bool] = lambda: False
) -> Iterator[Step]:
    """Every step of a run, with all epochs of its world; the last one's truth holds the verdict.

    Args:
        scenario: what is driven, with the faults that are to befall it.
        facts: with which estimator, solver and seed.
        clock: times the robots' decisions.
        interrupted: asked once a step; ends the run with the verdict ``interrupted``.

    Raises:
        ValueError: an estimator needs something that the scene does not hold.
    """
    faults = schedule(scenario.faults, seed=facts.seed, step_s=scenario.step_s)
    restarts = {each.begin for each in of_kind(faults, RestartWorld)}
    driven, scene = effective(scenario, facts.seed), scenario.scene(with_goals=facts.goals_are_exchanged)
    total_steps = count()
    for epoch in count(EPOCH):
        world = World(driven, seed=facts.seed, epoch=epoch)
        judge = Judge(world, SILENT)
        robots = {robot.id: _Robot(robot, scene, facts, faults, clock, epoch) for robot in scenario.robots}
        for total_step in total_steps:
            truth, observations = world.truth(judge.refused), world.observations()
            if world.over:
                yield Step(truth, {}, {}, {})
                return
            if total_step in restarts:
                yield Step(truth, observations, {}, {})  # nobody answers this world any more
                break
            judge.begin_step()
            decisions: dict[str, Decision] = {}
            commands: dict[str, tuple[Command, ...]] = {}
            for name, robot in robots.items():
                decision, said = robot.step(total_step, observations.get(name), judge)
                if decision is not None:
                    decisions[name] = decision
                commands[name] = said
            yield Step(truth, observations, decisions, commands)
            if interrupted():
                world.interrupt()
            else:
                world.advance(judge.answers)


class _Robot:
    """A robot in one epoch of the world.

    Without faults, whatever is said reaches whom it is for, as it was said. With faults, it goes as bytes
    over a link that has them, and the process may be down, and then begin anew.
    """

    def __init__(
        self,
        robot: ScenarioRobot,
        scene: Scene,
        facts: RunFacts,
        faults: Sequence[Scheduled[Fault]],
        clock: Clock,
        epoch: int,
    ) -> None:
        own = of_kind(faults, (*LINK_FAULTS, *MIND_FAULTS, DownFault), robot.id)
        self._name, self._epoch = robot.id, epoch
        self._link = Link(own, robot.id, scene) if own else None
        self._down_faults = of_kind(own, DownFault)
        self._is_killed = False

        def make_mind() -> Decides:
            if of_kind(own, MIND_FAULTS):
                return FaultyMind(robot.id, robot.goal_pose(), scene, own, facts, clock)
            return facts.agent(robot.id, robot.goal_pose(), scene, clock)

        self._make_mind = make_mind
        self._begin()

    def _begin(self) -> None:
        self._inbox, self._mind = Inbox(SILENT), self._make_mind()

    def step(
        self, total_step: int, observation: Observation | None, judge: Judge
    ) -> tuple[Decision | None, tuple[Command, ...]]:
        """Take part in a step.

        Args:
            total_step: since the first start of the world.
            observation: as the world gives it; None while the robot is not in the scene.
            judge: gets what reaches the world.

        Returns:
            The robot's decision, None where it made none; and what of it reached the world.
        """
        runs = self._runs(total_step)
        if observation is None:
            return None, ()
        if self._link is None:
            decision = self._mind.decide(observation)
            if decision is None:
                return None, ()
            judge.take(self._name, decision.command)
            return decision, (decision.command,)
        due, delivery = self._link.due(observation.step), self._link.observed(observation)
        decision = self._decide(delivery.payloads) if runs else None
        said = () if decision is None else self._link.commanded(encode(decision.command))
        judged = [judge.judge(self._name, payload) for payload in (*due, *said)]
        return decision, tuple(command for command in judged if command is not None)

    def _runs(self, total_step: int) -> bool:
        """Whether the process runs; one that was killed is started at its return."""
        down = [each.fault for each in self._down_faults if each.is_on(total_step)]
        was_killed, self._is_killed = self._is_killed, any(fault.forgets for fault in down)
        if was_killed and not self._is_killed:
            self._begin()
        return not down

    def _decide(self, payloads: Sequence[bytes]) -> Decision | None:
        for payload in payloads:
            self._inbox.store(payload)
        newest = self._inbox.next() if self._inbox.has_news() else None
        if not isinstance(newest, Observation) or newest.epoch != self._epoch:
            return None  # a process asks the world for its epoch, and stays in the one that it has joined
        return self._mind.decide(newest)


def simulate(experiment: Experiment, interruption: Interruption) -> Iterator[BusMessage]:
    """Every message that the processes would have exchanged in lock-step, in the same order of steps.

    Raises:
        Refusal: the solver cannot be compiled.
        KeyboardInterrupt: an interruption came while it was compiled.
        ValueError: an estimator needs something that the scene does not hold.
    """
    scenario, facts = experiment.scenario, experiment.facts
    compile_solver(interruption)
    warm_up(facts.goals, facts.solver)
    keys = Keys(facts.run)
    scene = scenario.scene(with_goals=facts.goals_are_exchanged)
    epoch, begun_ns, now_ns = None, 0, 0
    for step in closed_loop(scenario, facts, time.perf_counter, lambda: interruption.requested):
        if step.truth.epoch != epoch:
            epoch, begun_ns = step.truth.epoch, now_ns
            yield BusMessage(keys.scene, PublicScene(epoch=epoch, scene=scene), begun_ns)
        now_ns = begun_ns + round(step.truth.time_s * 1e9)
        for robot, observation in step.observations.items():
            yield BusMessage(keys.pose(robot), observation, now_ns)
        yield BusMessage(keys.truth, step.truth, now_ns)
        for robot, commands in step.commands.items():
            if robot in step.decisions:
                yield BusMessage(keys.mind(robot), step.decisions[robot].mind, now_ns)
            for command in commands:
                yield BusMessage(keys.command(robot), command, now_ns)
