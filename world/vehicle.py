"""One vehicle and the rule of what it drives at a step, with a command and without one."""

from dataclasses import dataclass

from protocol.messages import Command
from protocol.vehicle import STANDSTILL, Input, Limits, braking_input
from world.physics import Driven, VehicleState, drive


@dataclass
class Vehicle:
    """A vehicle as the world moves it, step by step.

    At a step without a command it drives the `then` of its last command if that answered the step before,
    and brakes otherwise. A command beyond the limits is clipped and counted, a fallback only clipped.

    Attributes:
        limits: of its inputs.
        step_s: Δt in s.
        state: at the present step.
        applied: the input that led there.
        fallback: what the command of the step before says for a step without one.
        deadline_misses: steps without a command so far.
        clipped_commands: commands so far that were beyond the limits.
    """

    limits: Limits
    step_s: float
    state: VehicleState
    applied: Input = STANDSTILL
    fallback: Input | None = None
    deadline_misses: int = 0
    clipped_commands: int = 0

    def driven_by(self, command: Command | None) -> Driven:
        """What the present step comes to with this command, or without one; nothing changes."""
        if command is not None:
            wanted = command.input
        else:
            wanted = self.fallback or braking_input(
                self.limits, self.applied, self.state.speed_mps, self.step_s
            )
        return drive(self.limits, self.state, self.applied, wanted, self.step_s)

    def obey(self, command: Command | None) -> None:
        """Drive to the next step.

        Args:
            command: of the present step; None: there is none that counts.
        """
        self.state, self.applied, clipped = self.driven_by(command)
        if command is None:
            self.deadline_misses += 1
            self.fallback = None
        else:
            self.clipped_commands += clipped
            self.fallback = command.then and Input(*command.then)

    def stand(self) -> None:
        """Be at rest where it is; what it was to drive is forgotten."""
        self.state = self.state._replace(speed_mps=0.0)
        self.applied, self.fallback = STANDSTILL, None
