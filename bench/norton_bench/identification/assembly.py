"""An actuator that stays assembled to its load, without a torque sensor: both machines from their two encoders.

The shaft between them twists in proportion to the torque. How stiff it is nobody knows, and the load's values need not
know: its own command sets the scale. So the twist, times any number, is fitted as the load's port torque, and all is
divided by the torque gain that comes out: the load's values in newton metres *as its drive counts them*.

Viscous damping is the exception. A twist that goes with velocity is also what two encoders show that are read half a
microsecond apart, so that one must be known from elsewhere.

With the load known, the port torque follows from its motion and its command, and the actuator is fitted to that.
"""

from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.fit import fit_signals
from norton_bench.identification.load import fit_machine, weight_of
from norton_bench.identification.machine import Machine
from norton_bench.identification.results import FitResult
from norton_bench.identification.signals import INTERPOLATION, Port, positions_of, signals
from norton_bench.identification.soundness.recording import sound
from norton_bench.models.parameters import HALF_INTERVAL, Status
from norton_bench.records import NO_DEVICE_TIME, TORQUE, Measured, Table
from norton_bench.segments import Use

# Any number will do; with this one the numbers look like torques.
TWIST_NM_RAD = 100.0
# A load's inertia that is not told better than this is not told.
LOOSEST = 0.05


@dataclass(frozen=True)
class LoadByTwist:
    """The load in newton metres as its drive counts them, the relative deviation of its inertia there, and what the
    weight of an arm on it gives at most, 0 where none hangs there: ``machine`` is the load without it."""

    machine: Machine
    inertia_deviation: float
    weight_nm: float = 0.0


def load_by_twist(measured: Measured, tick_s: float) -> LoadByTwist:
    """The load, from segments in which both machines were shaken (Use.CALIBRATE), each in its own way.

    Raises ExperimentError where the shaft twists too little to tell the load's inertia from the actuator's.
    """
    twisted = signals(with_twist(sound(measured).measured), tick_s, Use.CALIBRATE, Port.LOAD)
    fit = fit_machine(twisted)
    gain, inertia = fit.estimate("torque_gain"), fit.estimate("inertia")
    if not fit.converged or gain.status is not Status.VALID or inertia.status is not Status.VALID:
        raise ExperimentError("the twist between the encoders does not tell the load's inertia from the actuator's")
    deviation = float(np.hypot(gain.std / gain.value, inertia.std / inertia.value))
    if not deviation < LOOSEST:
        raise ExperimentError(
            f"the twist between the encoders tells the load's inertia to ±{HALF_INTERVAL * deviation:.0%} only"
        )
    return LoadByTwist(Machine.of_fit(fit).in_drive_units(), deviation, weight_of(fit) / gain.value)


def actuator_behind(measured: Measured, load: Machine, tick_s: float, command_unit: str) -> FitResult:
    """The actuator, from the same segments, with the torque at its port as the load's motion and command tell it.

    Raises ExperimentError where there is nothing to fit.
    """
    believed = with_torque_of(sound(measured).measured, load, tick_s)
    return fit_signals(signals(believed, tick_s, Use.CALIBRATE, Port.ACTUATOR), command_unit=command_unit)


def with_twist(measured: Measured) -> Measured:
    """With TWIST_NM_RAD times the twist in place of the torque readings, whenever the load's position was read."""
    origin_ns = int(measured.ticks["tick_ns"][0])
    load = positions_of(measured.load_motion, origin_ns)
    actuator = positions_of(measured.motion, origin_ns)
    reach_s = INTERPOLATION.half_width * actuator.period_s
    within = (load.time_s > actuator.time_s[0] + reach_s) & (load.time_s < actuator.time_s[-1] - reach_s)
    at_s = load.time_s[within]
    twist_rad = actuator.at(at_s) - load.value[within]
    return replace(measured, torque=_readings(at_s, TWIST_NM_RAD * twist_rad, origin_ns))


def with_torque_of(measured: Measured, load: Machine, tick_s: float) -> Measured:
    """With the port torque as the load tells it in place of the torque readings, once a tick."""
    origin_ns = int(measured.ticks["tick_ns"][0])
    position = positions_of(measured.load_motion, origin_ns)
    reach_s = INTERPOLATION.half_width * position.period_s
    ticks_s = (measured.ticks["tick_ns"] - origin_ns) * 1e-9
    within = (ticks_s > position.time_s[0] + reach_s) & (ticks_s < position.time_s[-1] - reach_s)
    at_s, sent_nm = ticks_s[within], measured.ticks["load_torque_nm"][within]
    torque_nm = -load.torque_nm(sent_nm, position.at(at_s), tick_s)
    return replace(measured, torque=_readings(at_s, torque_nm, origin_ns))


def _readings(at_s: FloatArray, torque_nm: FloatArray, origin_ns: int) -> Table:
    table = np.zeros(len(at_s), TORQUE)
    table["arrival_ns"] = origin_ns + np.round(at_s * 1e9).astype(np.int64)
    table["device_ns"] = NO_DEVICE_TIME
    table["sequence"] = np.arange(len(at_s))
    table["torque_nm"], table["valid"] = torque_nm, True
    return table
