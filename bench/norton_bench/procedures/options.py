"""What may be asked of each procedure. Amplitudes are fractions of the rig's velocity limit."""

from dataclasses import dataclass
from typing import Literal

History = Literal["slow", "fast", "rest"]


@dataclass(frozen=True)
class TareOptions:
    """Bias and noise at rest."""

    duration_s: float = 2.0


@dataclass(frozen=True)
class CalibrateOptions:
    """The load drive's own dynamics."""

    duration_s: float = 8.0


@dataclass(frozen=True)
class FreeOptions:
    """Zero torque at the port: a staircase of ``levels`` commands from both sides, then a multisine command."""

    amplitude: float = 0.6
    levels: int = 11
    dwell_s: float = 0.4  # on each level of the staircase
    duration_s: float = 12.0  # of the multisine


@dataclass(frozen=True)
class BlockedOptions:
    """The shaft held: torque against command, by how standstill was reached.

    ``histories``: "slow" and "fast" approach each level from both sides; "rest" does not move at all.
    """

    levels: int = 5
    hold_s: float = 0.5
    histories: tuple[History, ...] = ("slow",)


@dataclass(frozen=True)
class ImposedOptions:
    """Imposed motion: a grid of velocities and commands, then a multisine motion under a multisine command."""

    amplitude: float = 0.5
    velocities_rad_s: tuple[float, ...] = ()  # of the grid; empty: chosen from ``amplitude``
    commands: int = 3  # levels of the grid
    duration_s: float = 20.0  # of the multisines


@dataclass(frozen=True)
class ValidateOptions:
    """Command and motion that no fit has seen."""

    duration_s: float = 8.0
    seed: int = 7


@dataclass(frozen=True)
class RefineOptions:
    """Excitations chosen as it goes, until every 95 % interval is within ± ``until`` of its value."""

    until: float = 0.01
    at_most_s: float = 300.0


@dataclass(frozen=True)
class IterateOptions:
    """One movement again and again: a multisine command up to ``highest_hz`` that fills the span found free."""

    trials: int = 10  # at most
    duration_s: float = 8.0
    highest_hz: float = 3.0
    seed: int = 5


@dataclass(frozen=True)
class InSituOptions:
    """One movement again and again while the actuator stays assembled to its load; no torque sensor is looked at.

    Of the load, ``viscous_damping_nms_rad`` and ``inertia_kgm2`` are what is believed beforehand, None where nothing
    is; both count newton metres as the load drive does. ``amplitude`` is that of the motion source, as foreseen.
    """

    trials: int = 12  # at most, those that are left alone among them
    duration_s: float = 8.0
    shake_s: float = 24.0  # before the first trial, to tell load and actuator apart
    highest_hz: float = 3.0
    amplitude: float = 0.5
    left_alone: float = 0.25  # the share of trials in which the load is not driven, at random
    viscous_damping_nms_rad: float | None = None
    inertia_kgm2: float | None = None
    seed: int = 6


@dataclass(frozen=True)
class RestOptions:
    """Nothing commanded, everything watched."""

    duration_s: float = 10.0


@dataclass(frozen=True)
class TabulateSourceOptions:
    """Where the free port rests, by command. Commands are shares of the greatest; ``port``: "actuator", "external"."""

    levels: int = 7
    lowest: float = -1.0
    highest: float = 1.0
    port: str = "actuator"
    settled_rad_s: float = 2e-3  # slower than this is at rest
    at_most_s: float = 3.0  # waited for that, at each level
    read_s: float = 0.5


@dataclass(frozen=True)
class TabulateImpedanceOptions:
    """What the port exerts away from its source, at some commands (shares of the greatest)."""

    commands: int = 3
    lowest: float = -0.5
    highest: float = 0.5
    displacement_rad: float = 0.05  # to either side
    steps: int = 4  # on the way there
    hold_s: float = 0.4
    shake_rad: float = 5e-3  # peak; 0: not at all
    sweep_rad_s: float = 0.05  # from end to end and back, so fast; 0: not at all
    settled_rad_s: float = 2e-3
    at_most_s: float = 3.0


Options = (
    TareOptions
    | CalibrateOptions
    | FreeOptions
    | BlockedOptions
    | ImposedOptions
    | RefineOptions
    | IterateOptions
    | InSituOptions
    | RestOptions
    | TabulateImpedanceOptions
    | TabulateSourceOptions
    | ValidateOptions
)
