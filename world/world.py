"""The simulated world as a pure core: commands in, observations out; and what real robots share with it."""

from abc import ABC, abstractmethod
from collections.abc import Mapping

from protocol.messages import (
    Accuracy,
    Command,
    Observation,
    Refusal,
    Refusals,
    State,
    TrueRobot,
    Truth,
    Verdict,
)
from protocol.scenario import Scenario
from protocol.scene import Rules
from world.referee import Distances, Referee
from world.sensing import Sensors
from world.vehicle import Vehicle, VehicleState


class BaseWorld(ABC):
    """Robots that observe, answer and drive, one step after the other: simulated or real ones.

    Nothing here reads a clock, starts a thread, or does input or output.

    Attributes:
        step: the present step.
        robots: ids of all robots, in the order of the scenario.
        verdict: None while the run goes on.

    Args:
        rules: what holds for all robots.
        vehicles: by robot, as they are at the first step.
        distances: what is measured of them.
        epoch: identifies this world in all its messages.
        step: the first step.
    """

    def __init__(
        self, rules: Rules, vehicles: dict[str, Vehicle], distances: Distances, *, epoch: int, step: int
    ) -> None:
        self.step = step
        self.robots = tuple(vehicles)
        self.verdict: Verdict | None = None
        self._rules = rules
        self._epoch = epoch
        self._vehicles = vehicles
        self._distances = distances
        self._arrived_s: Mapping[str, float | None] = dict.fromkeys(vehicles)

    @property
    def present(self) -> tuple[str, ...]:
        """Ids of the robots that are in the scene at the present step."""
        return tuple(self._states())

    @property
    def over(self) -> bool:
        """Whether the run has ended."""
        return self.verdict is not None

    @abstractmethod
    def observations(self) -> Mapping[str, Observation]:
        """What each robot in the scene sees at the present step."""

    @abstractmethod
    def _states(self) -> Mapping[str, VehicleState]:
        """Where the robots are that are in the scene, in the order of all."""

    def refusal(self, robot: str, command: Command) -> Refusal | None:
        """Why a command that came from this robot does not answer the present step, None if it does."""
        if command.robot != robot:
            return "names another robot"
        if command.epoch != self._epoch:
            return "answers another epoch"
        if command.step != self.step:
            return "answers another step"
        return None

    def heed(self, robot: str, command: Command) -> None:  # noqa: B027  # nothing, where steps are awaited
        """A robot's command for the present step has been taken; for worlds that do not wait for its end."""

    def advance(self, commands: Mapping[str, Command]) -> None:
        """Drive all robots to the next step.

        A robot without a command, or with one that is withheld or that `refusal` objects to, has missed its
        deadline, which is counted; :class:`world.vehicle.Vehicle` says what it drives then. Robots that have
        arrived go on obeying; those that are not in the scene stand still.
        """
        present = self.present
        for robot, vehicle in self._vehicles.items():
            if robot in present:
                vehicle.obey(self._answer(robot, commands.get(robot)))
            else:
                vehicle.stand()
        self.step += 1

    def interrupt(self) -> None:
        """End a run that goes on; its verdict is "interrupted"."""
        self.verdict = self.verdict or "interrupted"

    def truth(self, refused: Refusals | None = None) -> Truth:
        """The states at the present step and the counts so far; with the verdict once the run is over."""
        return Truth(
            epoch=self._epoch,
            step=self.step,
            time_s=self._rules.time_s(self.step),
            robots={
                robot: TrueRobot(
                    state=State.of(*state),
                    turn_rate_radps=self._vehicles[robot].applied.turn_rate_radps,
                    acceleration_mps2=self._vehicles[robot].applied.acceleration_mps2,
                    arrived_s=self._arrived_s[robot],
                    driven_m=self._distances.driven_m[robot],
                    deadline_misses=self._vehicles[robot].deadline_misses,
                    clipped_commands=self._vehicles[robot].clipped_commands,
                )
                for robot, state in self._states().items()
            },
            minimum_distance_m=self._distances.minimum_distance_m,
            collisions=self._distances.collisions,
            verdict=self.verdict,
            refused=refused or {},
        )

    def _answer(self, robot: str, command: Command | None) -> Command | None:
        """The command of a robot for the present step, if there is one that counts."""
        counts = command and not command.withheld and self.refusal(robot, command) is None
        return command if counts else None

    def _observation(self, robots: dict[str, State], accuracy: Accuracy, age_steps: int = 0) -> Observation:
        return Observation(
            epoch=self._epoch,
            step=self.step,
            time_s=self._rules.time_s(self.step),
            robots=robots,
            age_steps=age_steps,
            accuracy=accuracy,
        )


class World(BaseWorld):
    """All robots of a scenario, their sensors and the referee.

    The same scenario, seed, epoch and commands give the same observations and truths bit for bit.

    Args:
        scenario: what is simulated.
        seed: of all random numbers (sensor noise and dropouts); not negative.
        epoch: identifies this world in all its messages.
    """

    def __init__(self, scenario: Scenario, *, seed: int, epoch: int) -> None:
        self._referee = Referee(scenario)
        self._robots = scenario.robots
        self._sensors = {
            robot.id: Sensors(robot.id, scenario.sensing_of(robot), seed=seed, index=index)
            for index, robot in enumerate(scenario.robots)
        }
        vehicles = {
            robot.id: Vehicle(robot.limits, scenario.step_s, VehicleState(*robot.start_state()))
            for robot in scenario.robots
        }
        super().__init__(scenario, vehicles, self._referee.distances, epoch=epoch, step=0)
        self._arrived_s = self._referee.arrived_s
        self._observe()

    def observations(self) -> Mapping[str, Observation]:
        """What each robot in the scene sees at the present step; drawn once, however often it is read."""
        return self._observations

    def advance(self, commands: Mapping[str, Command]) -> None:
        """Drive all robots to the next step, see :meth:`BaseWorld.advance`.

        Raises:
            RuntimeError: the run has ended.
        """
        if self.over:
            raise RuntimeError(f"the run has ended at step {self.step}; it cannot be advanced")
        super().advance(commands)
        self._observe()

    def _states(self) -> Mapping[str, VehicleState]:
        time_s = self._rules.time_s(self.step)
        present = [robot.id for robot in self._robots if robot.is_present(time_s)]
        return {robot: self._vehicles[robot].state for robot in present}

    def _observe(self) -> None:
        present = self._states()
        self._referee.watch(self.step, present)
        self.verdict = self._referee.verdict
        states = {robot: vehicle.state for robot, vehicle in self._vehicles.items()}
        views = {robot: sensors.see(states, present) for robot, sensors in self._sensors.items()}
        self._observations = {
            robot: self._observation(view.robots, self._sensors[robot].accuracy, view.age_steps)
            for robot, view in views.items()
            if robot in present
        }
