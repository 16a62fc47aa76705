"""What an observation tells that can be believed, and what takes the place of what cannot."""

from collections.abc import Sequence

import numpy as np

from agent.remember.gate import Gate
from agent.remember.memory import Memory
from agent.solve.vehicle import rollout
from protocol.messages import Observation
from protocol.scene import Scene
from protocol.vehicle import Input


class Perception:
    """Takes observations into a robot's memory: through the gate, and by dead reckoning where it must.

    Args:
        scene: limits, step and horizons.
        robot: who observes.

    Attributes:
        memory: what it believes of everybody.
    """

    def __init__(self, scene: Scene, robot: str) -> None:
        self._robot = robot
        self._step_s = scene.step_s
        self._gate = Gate(scene.step_s, lambda each: scene.robot(each).limits)
        self.memory = Memory(
            scene.horizons.estimation_steps + 2,
            scene.step_s,
            owner=robot,
            limits_of=lambda each: scene.robot(each).limits,
        )

    def take_in(self, observation: Observation, driven: Input | None) -> set[str]:
        """Remember what is believed of an observation.

        Args:
            observation: of a step; one that is not newer than the last one changes nothing.
            driven: the robot's own input at the step before, if it is known. With it, a robot whose own pose
                is not believed takes itself to be where it should be by what it has driven.

        Returns:
            The robots whose sightings are not believed.
        """
        if observation.step <= self.memory.step:
            return set()
        seen, refused = self._judged(observation)
        if self._robot in refused and driven is not None:
            seen[self._robot] = self._dead_reckoned(observation.step, driven)
        self.memory.remember(
            observation.step,
            seen,
            sigmas=observation.accuracy.as_tuple(),
            age_steps=observation.age_steps,
            driven=driven,
        )
        return refused

    def _judged(self, observation: Observation) -> tuple[dict[str, Sequence[float]], set[str]]:
        """What is believed, and of whom nothing is; what is believed anew leaves nothing of what was."""
        seen: dict[str, Sequence[float]] = {}
        refused = set()
        for robot, state in observation.robots.items():
            step = observation.step - (0 if robot == self._robot else observation.age_steps)
            judgement = self._gate.judge(robot, step, state, observation.accuracy)
            if judgement == "refused":
                refused.add(robot)
                continue
            if judgement == "reacquired":
                self.memory.forget(robot)
            seen[robot] = state.as_tuple()
        return seen, refused

    def _dead_reckoned(self, step: int, driven: Input) -> list[float]:
        """Where this robot should be, had it driven the same since it last knew."""
        inputs = np.tile(driven, (step - self.memory.step, 1))
        reckoned: list[float] = rollout(self.memory.state(self._robot), inputs, self._step_s)[-1].tolist()
        return reckoned
