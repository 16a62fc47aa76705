"""The simulated world as a pure core: commands in, observations out."""

from collections.abc import Mapping
from dataclasses import dataclass

from protocol.messages import Command, Observation, Refusal, Refusals, State, TrueRobot, Truth
from protocol.scenario import Scenario, ScenarioRobot
from protocol.vehicle import STANDSTILL, Input, Limits, braking_input
from world.physics import Driven, VehicleState, drive
from world.referee import Referee
from world.sensing import Sensors, View


@dataclass
class _Vehicle:
    robot: ScenarioRobot
    limits: Limits
    state: VehicleState
    applied: Input = STANDSTILL
    fallback: Input | None = None
    """What the command of the step before says for a step without one."""
    deadline_misses: int = 0
    clipped_commands: int = 0

    def stand(self) -> None:
        """Outside the scene nothing moves."""
        self.state = self.state._replace(speed_mps=0.0)
        self.applied, self.fallback = STANDSTILL, None


class World:
    """All robots of a scenario, their sensors and the referee, one step after the other.

    Nothing here reads a clock, starts a thread, or does input or output: the same scenario, seed, epoch and
    commands give the same observations and truths bit for bit.

    Args:
        scenario: what is simulated.
        seed: of all random numbers (sensor noise and dropouts); not negative.
        epoch: identifies this world in all its messages.
    """

    def __init__(self, scenario: Scenario, *, seed: int, epoch: int) -> None:
        self._epoch = epoch
        self._scenario = scenario
        self._step = 0
        self._vehicles = {
            robot.id: _Vehicle(robot, robot.limits, VehicleState(*robot.start_state()))
            for robot in scenario.robots
        }
        self._sensors = {
            robot.id: Sensors(robot.id, scenario.sensing_of(robot), seed=seed, index=index)
            for index, robot in enumerate(scenario.robots)
        }
        self._referee = Referee(scenario)
        self._observe()

    @property
    def step(self) -> int:
        """The present step."""
        return self._step

    @property
    def robots(self) -> tuple[str, ...]:
        """Ids of all robots, in the order of the scenario."""
        return tuple(self._vehicles)

    @property
    def present(self) -> tuple[str, ...]:
        """Ids of the robots that are in the scene at the present step."""
        time_s = self._scenario.time_s(self._step)
        return tuple(name for name, each in self._vehicles.items() if each.robot.is_present(time_s))

    @property
    def over(self) -> bool:
        """Whether the run has ended."""
        return self._referee.verdict is not None

    def observations(self) -> dict[str, Observation]:
        """What each robot in the scene sees at the present step; drawn once, however often it is read."""
        return self._observations

    def refusal(self, robot: str, command: Command) -> Refusal | None:
        """Why a command that came from this robot does not answer the present step, None if it does."""
        if command.robot != robot:
            return "names another robot"
        if command.epoch != self._epoch:
            return "answers another epoch"
        if command.step != self._step:
            return "answers another step"
        return None

    def advance(self, commands: Mapping[str, Command]) -> dict[str, Observation]:
        """Drive all robots to the next step.

        A robot without a command, or with one that is withheld or that `refusal` objects to, has missed its
        deadline, which is counted. It drives the `then` of its last command if that answered the step before,
        and brakes otherwise. A command beyond the limits is clipped and counted, a fallback only clipped.
        Robots that have arrived go on obeying; those that are not in the scene stand still.

        Args:
            commands: the commands of the present step by the robot that gave them.

        Returns:
            The observations of the new step.

        Raises:
            RuntimeError: the run has ended.
        """
        if self.over:
            raise RuntimeError(f"the run has ended at step {self._step}; it cannot be advanced")
        present = self.present
        for robot, vehicle in self._vehicles.items():
            if robot not in present:
                vehicle.stand()
                continue
            command = commands.get(robot)
            if command is None or command.withheld or self.refusal(robot, command) is not None:
                vehicle.deadline_misses += 1
                wanted = vehicle.fallback or self._braking(vehicle)
                vehicle.state, vehicle.applied, _ = self._drive(vehicle, wanted)
                vehicle.fallback = None
            else:
                vehicle.state, vehicle.applied, clipped = self._drive(vehicle, command.input)
                vehicle.clipped_commands += clipped
                vehicle.fallback = command.then and Input(*command.then)
        self._step += 1
        self._observe()
        return self._observations

    def interrupt(self) -> None:
        """End a run that goes on; its verdict is "interrupted"."""
        self._referee.interrupt()

    def truth(self, refused: Refusals | None = None) -> Truth:
        """The true states at the present step and the referee's counts; with the verdict once it is over.

        Args:
            refused: commands that were not taken so far.
        """
        referee, present = self._referee, self.present
        return Truth(
            epoch=self._epoch,
            step=self._step,
            time_s=self._scenario.time_s(self._step),
            robots={
                robot: TrueRobot(
                    state=State.of(*vehicle.state),
                    turn_rate_radps=vehicle.applied.turn_rate_radps,
                    acceleration_mps2=vehicle.applied.acceleration_mps2,
                    arrived_s=referee.arrived_s[robot],
                    driven_m=referee.driven_m[robot],
                    deadline_misses=vehicle.deadline_misses,
                    clipped_commands=vehicle.clipped_commands,
                )
                for robot, vehicle in self._vehicles.items()
                if robot in present
            },
            minimum_distance_m=referee.minimum_distance_m,
            collisions=referee.collisions,
            verdict=referee.verdict,
            refused=refused or {},
        )

    def _braking(self, vehicle: _Vehicle) -> Input:
        return braking_input(vehicle.limits, vehicle.applied, vehicle.state.speed_mps, self._scenario.step_s)

    def _drive(self, vehicle: _Vehicle, wanted: Input) -> Driven:
        return drive(vehicle.limits, vehicle.state, vehicle.applied, wanted, self._scenario.step_s)

    def _observe(self) -> None:
        states = {robot: vehicle.state for robot, vehicle in self._vehicles.items()}
        present = self.present
        self._referee.watch(self._step, {robot: states[robot] for robot in present})
        views = {robot: sensors.see(states, present) for robot, sensors in self._sensors.items()}
        self._observations = {robot: self._observation(views[robot], robot) for robot in present}

    def _observation(self, view: View, robot: str) -> Observation:
        return Observation(
            epoch=self._epoch,
            step=self._step,
            time_s=self._scenario.time_s(self._step),
            robots=view.robots,
            age_steps=view.age_steps,
            accuracy=self._sensors[robot].accuracy,
        )
