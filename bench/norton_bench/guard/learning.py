"""What the guard leans on, read from what was measured while all was well."""

import numpy as np
import numpy.typing as npt

from norton_bench.guard.known import TorqueHabits
from norton_bench.records import Measured, Table

# A slope counts as seen where it is so many of its own deviations.
SEEN = 10.0
# Readings further apart than this many periods are no neighbours.
NEIGHBOURS = 1.5
HALF_STEP = 0.5


def torque_habits(at_rest: Measured, shaken: Measured | None) -> TorqueHabits | None:
    """How the torque sensor behaves with the drives at zero, and by how much it changes at most; None without one."""
    torque = at_rest.torque[at_rest.torque["valid"]]
    if len(torque) < 2:
        return None
    torque_nm = torque["torque_nm"]
    period_s = float(np.median(np.diff(torque["arrival_ns"]))) * 1e-9
    return TorqueHabits(
        bias_nm=float(np.mean(torque_nm)),
        noise_nm=float(np.std(torque_nm)),
        period_s=period_s,
        longest_repeat=_longest_repeat(torque_nm) if _shows_noise(torque_nm) else None,
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


def _shows_noise(values: npt.NDArray[np.float64]) -> bool:
    """Whether the noise is at least half a step of the readings: by that a living sensor keeps changing."""
    steps = np.abs(np.diff(values))
    return bool(np.any(steps > 0.0) and np.std(values) >= HALF_STEP * np.min(steps[steps > 0.0]))


def _longest_repeat(values: npt.NDArray[np.float64]) -> int:
    changes = np.flatnonzero(np.diff(values) != 0.0)
    return int(np.max(np.diff(np.concatenate([[-1], changes, [len(values) - 1]]))))


def _greatest_step_nm(torque: Table, period_s: float) -> float | None:
    neighbours = np.diff(torque["arrival_ns"]) * 1e-9 <= NEIGHBOURS * period_s
    steps_nm = np.abs(np.diff(torque["torque_nm"]))[neighbours & torque["valid"][1:] & torque["valid"][:-1]]
    return float(np.max(steps_nm)) if len(steps_nm) else None
