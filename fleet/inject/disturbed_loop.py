"""A run in virtual time with the faults that befall it.

What befalls links and minds is counted in steps of the present epoch, as observations tell them. What befalls
processes happens once in a run: it is counted in steps since the first start of the world. A robot that is
down is one that nothing reaches. The downtime of the world has no meaning here, since nobody waits; nor have
a pause of the machine and a step of its wall clock. What befalls the recording does not concern the run.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import count
from typing import Any

from agent.agent import Decision
from agent.solve.deadline import Clock
from fleet.inject.effective import effective
from fleet.inject.schedule import Scheduled, schedule
from fleet.inject.virtual_robot import SILENT, virtual_robot
from fleet.run.experiment import RunFacts
from fleet.run.moment import EPOCH, Moment
from protocol.faults import Fault, Freeze, Kill, RestartWorld
from protocol.messages import Command
from protocol.scenario import Scenario
from world.judge import Judge
from world.world import World


def disturbed_loop(
    scenario: Scenario, facts: RunFacts, clock: Clock, interrupted: Callable[[], bool]
) -> Iterator[Moment]:
    """See :func:`fleet.run.virtual.closed_loop`; with a restart of the world, of all its epochs.

    Raises:
        ValueError: an estimator needs something that the scene does not hold.
    """
    faults = schedule(scenario.faults, seed=facts.seed, step_s=scenario.step_s)
    restarts = {each.begin for each in faults if isinstance(each.fault, RestartWorld)}
    epochs = count(EPOCH)
    epoch = _Epoch(scenario, facts, faults, clock, next(epochs))
    for total_steps in count():
        if epoch.world.over:
            break
        if total_steps in restarts:
            yield epoch.cut()
            epoch = _Epoch(scenario, facts, faults, clock, next(epochs))
            continue
        yield epoch.moment(total_steps)
        if interrupted():
            epoch.world.interrupt()
        else:
            epoch.advance()
    yield epoch.end()


class _Epoch:
    """A world from its start to its end, with its robots.

    Args:
        scenario: what is driven.
        facts: of the run.
        faults: of the run.
        clock: times the robots' decisions.
        number: of the epoch.
    """

    def __init__(
        self,
        scenario: Scenario,
        facts: RunFacts,
        faults: Sequence[Scheduled[Fault]],
        clock: Clock,
        number: int,
    ) -> None:
        self.world = World(effective(scenario, facts.seed), seed=facts.seed, epoch=number)
        self._judge = Judge(self.world, SILENT)
        self._faults = faults
        scene = scenario.scene(with_goals=facts.goals_are_exchanged)
        self._robots = {
            robot.id: virtual_robot(robot, scene, facts, faults, clock, number) for robot in scenario.robots
        }
        self._killed: set[str] = set()

    def moment(self, total_steps: int) -> Moment:
        """The present step, with what comes of it."""
        self._judge.begin_step()
        truth, observations = self.world.truth(self._judge.refused), self.world.observations()
        decisions: dict[str, Decision] = {}
        commands: dict[str, tuple[Command, ...]] = {}
        for name, robot in self._robots.items():
            runs = self._runs(name, total_steps)
            if name not in observations:
                continue
            due = robot.due(self.world.step)
            decision, said = robot.shown(observations[name], runs=runs)
            if decision is not None:
                decisions[name] = decision
            judged = [self._judge.judge(name, payload) for payload in (*due, *said)]
            commands[name] = tuple(command for command in judged if command is not None)
        return Moment(truth, observations, decisions, commands)

    def advance(self) -> None:
        """On to the next step with the commands that the world has taken."""
        self.world.advance(self._judge.answers)

    def cut(self) -> Moment:
        """The present step of a world that comes no further: nobody answers it any more."""
        return Moment(self.world.truth(self._judge.refused), self.world.observations(), {}, {})

    def end(self) -> Moment:
        """The last step, with the verdict."""
        return Moment(self.world.truth(self._judge.refused), {}, {}, {})

    def _runs(self, robot: str, total_steps: int) -> bool:
        """Whether there is a process of a robot that runs; one that was killed is started at its return."""
        if self._strikes(Kill, robot, total_steps):
            self._killed.add(robot)
        elif robot in self._killed:
            self._killed.remove(robot)
            self._robots[robot].start()
        return robot not in self._killed and not self._strikes(Freeze, robot, total_steps)

    def _strikes(self, kind: type[Any], robot: str, total_steps: int) -> bool:
        return any(isinstance(each.fault, kind) and each.strikes(robot, total_steps) for each in self._faults)
