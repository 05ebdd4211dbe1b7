"""What every plausibility check is given, what it must say, and what it knows of the bench (:class:`GuardModel`)."""

from dataclasses import dataclass
from enum import IntFlag
from math import ceil, log
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from norton_bench.records import Measured, Table
from norton_bench.sample import Sample
from norton_drivers.readings import DriveStatus


# What the bench has measured of itself, as far as the guard relies on it.
@dataclass(frozen=True)
class Machine:
    """One of the two machines at the port, as it was identified. Torques are at the shaft.

    ``weight_nm`` is the greatest torque of an arm that hangs on it, ``lag_s`` how long a command takes to show in
    the readings: on its way, in the amplifier, and back.
    """

    torque_gain: float  # N m per unit of its command
    inertia_kgm2: float
    viscous_damping_nms_rad: float
    coulomb_torque_nm: float
    weight_nm: float = 0.0
    lag_s: float = 0.0


@dataclass(frozen=True)
class TorqueReadings:
    """How the torque sensor's readings come and differ.

    ``longest_repeat`` counts the readings in a row, at rest, that were the same bit for bit (1: no two were), or would
    have been with the torque in the middle of a step of the readings; None where the noise may be less than a quarter
    of a step, so that they may stay the same for long.
    ``greatest_step_nm`` is the greatest difference of neighbours while the bench was shaken; None before it was.
    """

    bias_nm: float
    noise_nm: float
    period_s: float
    longest_repeat: int | None
    greatest_step_nm: float | None = None


@dataclass(frozen=True)
class GuardModel:
    """None stands for what nobody has measured yet, or cannot be on this rig.

    ``moving_command`` is the command at which the free actuator began to turn. Amperes are per unit of the command of
    each drive; of either sign. ``still_swing_nm`` is the greatest swing of the port torque under which the actuator's
    encoder stayed where it was.
    """

    torque: TorqueReadings | None = None
    moving_command: float | None = None
    amperes_per_command: float | None = None
    load_amperes_per_nm: float | None = None
    sensor_stiffness_nm_rad: float | None = None
    still_swing_nm: float | None = None
    actuator: Machine | None = None
    load: Machine | None = None


EMPTY_MODEL = GuardModel()


# A slope counts as seen where it is so many of its own deviations.
SEEN = 10.0
# Readings further apart than this many periods are no neighbours.
NEIGHBOURS = 1.5
# Of readings with noise of a quarter of a step 95 % are the same in the middle of a step, some hundred in a row.
LEAST_NOISE = 0.25  # steps
MOST_NOISE = 2.0  # steps; with more, where the torque lies in a step makes no difference
LIKELY = 1.92  # of the log likelihood, with 95 %
OUTLIERS = 5e-3  # the share of readings that are no noise: a knock on the bench
MOST_LEVELS = 10  # to either side: outliers are as likely at each
QUARTILES = (25.0, 75.0)
NORMAL_OF_QUARTILES = 0.7413  # the deviation of normal values, over the distance of their quartiles


# What the guard relies on, read from what was measured while all was well.
def torque_readings(at_rest: Measured, shaken: Measured | None) -> TorqueReadings | None:
    """How the torque sensor behaves with the drives at zero, and by how much it changes at most; None without one."""
    torque = at_rest.torque[at_rest.torque["valid"]]
    if len(torque) < 2:
        return None
    torque_nm = torque["torque_nm"]
    period_s = float(np.median(np.diff(torque["arrival_ns"]))) * 1e-9
    return TorqueReadings(
        bias_nm=float(np.mean(torque_nm)),
        noise_nm=float(np.std(torque_nm)),
        period_s=period_s,
        longest_repeat=_longest_repeat(torque_nm),
        greatest_step_nm=None if shaken is None else _greatest_step_nm(shaken.torque, period_s),
    )


def amperes_per_command(ticks: Table, command: str, current: Table) -> float | None:
    """The slope of the current over the column ``command`` of the ticks; None where nothing of it is to be seen."""
    if len(current) < 3 or not len(ticks):
        return None
    at = np.searchsorted(ticks["tick_ns"], current["arrival_ns"], side="right") - 1
    commanded = ticks[command][np.maximum(at, 0)]
    command_off, current_off = commanded - np.mean(commanded), current["current_a"] - np.mean(current["current_a"])
    size = float(command_off @ command_off)
    if size == 0.0:
        return None
    slope = float(command_off @ current_off) / size
    rest_a = current_off - slope * command_off
    deviation = float(np.sqrt(rest_a @ rest_a / (len(rest_a) - 2) / size))
    return slope if abs(slope) > SEEN * deviation else None


def still_swing_nm(measured: Measured) -> float:
    """The greatest swing of the port torque [N m] while the actuator's encoder stood still, bit for bit."""
    motion, torque = measured.motion, measured.torque[measured.torque["valid"]]
    if not len(motion) or not len(torque):
        return 0.0
    turns = np.flatnonzero(np.diff(motion["position_rad"]) != 0.0) + 1
    stands = np.unique(np.searchsorted(torque["arrival_ns"], motion["arrival_ns"][np.concatenate([[0], turns])]))
    torque_nm, stands = torque["torque_nm"], stands[stands < len(torque)]
    return float(np.max(np.maximum.reduceat(torque_nm, stands) - np.minimum.reduceat(torque_nm, stands), initial=0.0))


def _longest_repeat(values: npt.NDArray[np.float64]) -> int | None:
    """See ``TorqueReadings``: the longest run seen, or to be expected in as many readings in the middle of a step."""
    changes = np.flatnonzero(np.diff(values) != 0.0)
    runs = np.diff(np.concatenate([[-1], changes, [len(values) - 1]]))
    shares = np.unique(values, return_counts=True)[1] / len(values)
    # So many readings in a row are one: a sensor that filters, or sends each value several times.
    alike = max(1.0, float(np.mean(runs)) * (1.0 - float(shares @ shares)))
    noise = _least_noise_in_steps(values, alike)
    if noise < LEAST_NOISE:
        return None
    seen = int(np.max(runs))
    if noise >= MOST_NOISE:
        return seen
    same = 2.0 * ndtr(0.5 / noise) - 1.0
    return max(seen, ceil(alike * log(len(values) / alike * (1.0 - same)) / -log(same)))


def _least_noise_in_steps(values: npt.NDArray[np.float64], alike: float) -> float:
    """The least deviation, in steps of the readings, with which a normal noise explains them (95 %), where ``alike``
    readings in a row count as one."""
    differences = np.abs(np.diff(np.unique(values)))
    if not len(differences):
        return 0.0
    steps = np.rint((values - np.median(values)) / np.min(differences))
    low, high = np.percentile(steps, QUARTILES)
    if NORMAL_OF_QUARTILES * (high - low) > MOST_NOISE:
        return MOST_NOISE
    steps = np.clip(steps, low - MOST_LEVELS, high + MOST_LEVELS)
    levels, counts = np.unique(steps, return_counts=True)
    noise = np.geomspace(0.02, MOST_NOISE, 60)[:, None, None]
    usual = np.mean(np.clip(steps, low - MOST_NOISE, high + MOST_NOISE))
    middle = usual + np.linspace(-0.5, 0.5, 41)[None, :, None]
    seen = ndtr((levels + 0.5 - middle) / noise) - ndtr((levels - 0.5 - middle) / noise)
    seen = (1.0 - OUTLIERS) * seen + OUTLIERS / (2.0 * MOST_LEVELS)
    likelihood = np.max(np.log(seen) @ (counts / alike), axis=1)
    return float(noise[np.flatnonzero(likelihood >= np.max(likelihood) - LIKELY)[0], 0, 0])


def _greatest_step_nm(torque: Table, period_s: float) -> float | None:
    neighbours = np.diff(torque["arrival_ns"]) * 1e-9 <= NEIGHBOURS * period_s
    steps_nm = np.abs(np.diff(torque["torque_nm"]))[neighbours & torque["valid"][1:] & torque["valid"][:-1]]
    return float(np.max(steps_nm)) if len(steps_nm) else None


class Limited(IntFlag):
    """What was clipped in a tick; clipping is no alarm, but it is recorded."""

    COMMAND = 1
    COMMAND_RATE = 2
    LOAD_TORQUE = 4
    MODULATION = 8


class Commands(NamedTuple):
    """What goes to the drives: the actuator's command in its own unit, the load's torque, and what was clipped.

    ``modulation`` is the modulator's command in its own unit; NaN once sent where there is none.
    """

    command: float
    load_torque_nm: float
    limited: int = 0
    modulation: float = 0.0


class DriveHealth(NamedTuple):
    """A drive's last word, and how long its heartbeat may be silent."""

    name: str
    status: DriveStatus
    heartbeat_timeout_ns: int


NOTHING = Commands(0.0, 0.0)


# A reading that is wrong once is a glitch; wrong as often as this, one after the other, it is a fault.
STRIKES = 3
# A position that stays where it was for so long, while it should move, is stuck.
PATIENCE_NS = 100_000_000
# An older reading of an encoder tells nothing: it is the business of [limits] stale_after.
FRESH_NS = 30_000_000
# Two positions may differ by so many steps of their resolution, and by this angle.
STEPS = 4
LEAST_RAD = 0.05


class Check(Protocol):
    """One relation between signals that must hold. Its name is the one that ``[guard] leave_out`` knows."""

    @property
    def name(self) -> str: ...

    def begin(self, sample: Sample) -> None:
        """The drives were just enabled at zero."""
        ...

    def learn(self, model: GuardModel) -> None:
        """From now on, use what was measured."""
        ...

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        """What is wrong, with place, numbers and mend; None where nothing is. ``sent`` is what acts since last tick."""
        ...
