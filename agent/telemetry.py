"""What a robot reports of each decision: what it thought, how it was degraded, how long it took."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from typing import get_args

from agent.remember.memory import Memory
from agent.solve import Clock
from agent.solve.planning import Plan
from agent.solve.prediction import Prediction
from agent.solve.vehicle import Array
from protocol.messages import Degradation, Mind, Observation, Phase, Positions, State, Timings


@dataclass
class Thought:
    """What one turn of algorithm 1 came to; a robot that has arrived thinks nothing."""

    refused: set[str]
    """Robots whose sightings are not believed."""
    arrived: bool
    goals: dict[str, Array] = field(default_factory=dict)
    prediction: Prediction | None = None
    plan: Plan | None = None
    emergency: Degradation | None = None
    """Why the plan is not followed."""

    @property
    def failed(self) -> tuple[Phase, ...]:
        """Phases whose problem was not solved. A failed prediction leaves nothing to plan with."""
        if self.prediction is not None and not self.prediction.solved:
            return ("predict",)
        if self.plan is not None and not self.plan.solved:
            return ("plan",)
        return ()


class Telemetry:
    """Times one robot's decisions and reports on them; counts since it joined an epoch."""

    def __init__(self, robot: str, clock: Clock) -> None:
        self._robot = robot
        self._clock = clock
        self._ordinals = count()
        self._solver_failures = 0

    def begin(self) -> None:
        """A decision begins."""
        self._begin_s = self._clock()
        self._phases_ms: dict[str, float] = {}

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Time the enclosed work as a phase of the decision."""
        begin_s = self._clock()
        yield
        self._phases_ms[name] = 1e3 * (self._clock() - begin_s)

    def mind(
        self,
        observation: Observation,
        memory: Memory,
        thought: Thought,
        interventions: int,
        cut_short_at: int | None,
    ) -> Mind:
        """The report of the decision, to be made once; interventions are those so far."""
        self._solver_failures += len(thought.failed)
        paths = thought.prediction.paths if thought.prediction else {}
        return Mind(
            epoch=observation.epoch,
            robot=self._robot,
            step=observation.step,
            decision=next(self._ordinals),
            arrived=thought.arrived,
            estimates={robot: State.of(*goal.tolist()) for robot, goal in thought.goals.items()},
            prediction={robot: _positions(path) for robot, path in paths.items()},
            plan=_positions(thought.plan.states) if thought.plan else (),
            failed=thought.failed,
            solver_failures=self._solver_failures,
            degraded=self._degradations(observation, memory, thought),
            interventions=interventions,
            cut_short_at=cut_short_at,
            timings_ms=Timings(**self._phases_ms, decide=1e3 * (self._clock() - self._begin_s)),
        )

    def _degradations(
        self, observation: Observation, memory: Memory, thought: Thought
    ) -> tuple[Degradation, ...]:
        """In which ways a decision was not as it should be."""
        others = (robot for robot in memory.robots if robot != self._robot)
        found: dict[Degradation | None, bool] = {
            "extrapolation": any(memory.unseen_steps(robot) > observation.age_steps for robot in others),
            "gate": bool(thought.refused),
            "solver failure": bool(thought.failed),
            thought.emergency: True,
        }
        return tuple(each for each in get_args(Degradation) if found.get(each))


def _positions(states: Array) -> Positions:
    return tuple(map(tuple, states[:, :2].tolist()))
