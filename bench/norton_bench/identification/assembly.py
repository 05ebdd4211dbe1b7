"""An actuator that stays assembled to its load: both machines, and what the load tells of the torque between them."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control.calibration import LoadCalibration
from norton_bench.control.preview import delayed
from norton_bench.errors import ExperimentError, UsageError
from norton_bench.identification.at_ticks import TickReadings, readings_at_ticks, sent_at_ticks
from norton_bench.identification.cleaning import clean
from norton_bench.identification.fit import fit_signals
from norton_bench.identification.load import fit_machine, weight_of
from norton_bench.identification.results import FitResult
from norton_bench.identification.signals import INTERPOLATION, Port, positions_of, signals
from norton_bench.models.drawn_motor import drawn_values, has_covariance, possible
from norton_bench.models.network import REQUIRED, NortonNetwork
from norton_bench.models.network_file import read_term, term_as_json
from norton_bench.models.parameters import HALF_INTERVAL, Status
from norton_bench.models.terms import NetworkTerm
from norton_bench.records import LOAD_TAKEN, NO_DEVICE_TIME, TORQUE, Event, Measured, SegmentInfo, Table
from norton_bench.segments import Use

# Parameters in which a torque counts.
TORQUES = ("inertia", "viscous_damping", "coulomb_torque", "presliding_stiffness", "presliding_damping")
# For a standard deviation to about a tenth.
DRAWN = 50


@dataclass(frozen=True)
class Machine:
    """One machine as its model sees it at the ticks: from what was sent and what arrived to the torque at its port.

    A network, and the delays of its command and its motion; both count from the arrivals of the same readings.
    """

    network: NortonNetwork
    command_delay_s: float
    motion_delay_s: float

    @classmethod
    def of_fit(cls, fit: FitResult) -> "Machine":
        return cls(fit.network, fit.command_delay_s, fit.motion_delay_s)

    @classmethod
    def of_load(cls, load: LoadCalibration) -> "Machine":
        motion_s = load.measurement_delay_s if load.motion_delay_s is None else load.motion_delay_s
        return cls(load.network, load.command_delay_s, motion_s)

    def in_drive_units(self) -> "Machine":
        """The same in newton metres as its own drive counts them: with a torque gain of 1."""
        network, gain = self.network, self.network.torque_gain
        scaled = replace(
            network,
            torque_gain=1.0,
            inertia_kgm2=network.inertia_kgm2 / gain,
            viscous_damping_nms_rad=network.viscous_damping_nms_rad / gain,
            coulomb_torque_nm=network.coulomb_torque_nm / gain,
            presliding_stiffness_nm_rad=network.presliding_stiffness_nm_rad / gain,
            presliding_damping_nms_rad=max(network.presliding_damping_nms_rad / gain, 0.0),
            terms=tuple(_per_torque(term, gain) for term in network.terms),
            covariance=_covariance_per_torque(network),
        )
        return replace(self, network=scaled)

    def knowing(self, name: str, value: float, std: float = 0.0) -> "Machine":
        """The same with one parameter known from elsewhere, by its name, and its standard deviation."""
        network = self.network.with_values({name: value})
        if name in network.covariance_names:
            place, covariance = network.covariance_names.index(name), np.array(network.covariance)
            covariance[place, :] = covariance[:, place] = 0.0
            covariance[place, place] = std**2
            network = replace(network, covariance=tuple(map(tuple, covariance.tolist())))
        return replace(self, network=network)

    def drawn(self) -> tuple["Machine", ...]:
        """DRAWN machines whose values go together as the covariance has them; none where there is none.

        Instead of a value that no machine can have it has its own. A viscous damping that was measured with an error
        may be below zero all the same.
        """
        network, names = self.network, self.network.covariance_names
        if not has_covariance(network) or not np.all(np.isfinite(network.covariance)):
            return ()
        own = [network.values()[name] for name in names]
        return tuple(
            replace(
                self,
                network=network.with_values(
                    {
                        name: value if name == "viscous_damping" or possible([name], [value]) else known
                        for name, value, known in zip(names, values, own, strict=True)
                    }
                ),
            )
            for values in drawn_values(network, seed=0)[:DRAWN].tolist()
        )

    def torque_nm(self, command: FloatArray, position_rad: FloatArray, tick_s: float) -> FloatArray:
        """What it exerts at its port, (ticks,), by what was sent to it and what arrived of its position."""
        held = delayed(command, tick_s, self.command_delay_s)
        return self.network.torque(held, delayed(position_rad, tick_s, -self.motion_delay_s), tick_s)

    def command_for(self, motor_nm: FloatArray, tick_s: float) -> FloatArray:
        """The commands, (ticks,), that give this motor torque at the instants at which they arrive."""
        stays = np.exp(-self.network.amplifier_bandwidth_rad_s * tick_s)
        wanted = delayed(motor_nm, tick_s, -self.command_delay_s)
        following = np.append(wanted[1:], wanted[-1])
        return np.asarray((following - stays * wanted) / (1.0 - stays) / self.network.torque_gain)


def _covariance_per_torque(network: NortonNetwork) -> tuple[tuple[float, ...], ...]:
    """That of the values divided by the torque gain, which is then 1."""
    if not network.covariance_names:
        return ()
    gain, values, names = network.torque_gain, network.values(), network.covariance_names
    torques = {*TORQUES, *(name for term in network.terms for name, unit in _units(term) if unit.startswith("N*m"))}
    slopes = np.diag([1.0 / gain if name in torques else 1.0 for name in names])
    if "torque_gain" in names:
        place = names.index("torque_gain")
        slopes[:, place] = [
            -values[name] / gain**2 if name in torques else slopes[row, place] for row, name in enumerate(names)
        ]
        slopes[place, place] = 0.0
    covariance = slopes @ np.asarray(network.covariance) @ slopes.T
    return tuple(map(tuple, covariance.tolist()))


def _units(term: NetworkTerm) -> list[tuple[str, str]]:
    return [(name, each.unit) for name, each in zip(term.named(), term.term.parameters, strict=True)]


def _per_torque(term: NetworkTerm, gain: float) -> NetworkTerm:
    """The term with torques of 1/``gain`` as many newton metres."""
    pairs = zip(term.term.parameters, term.values, strict=True)
    return replace(term, values=tuple(value / gain if each.unit.startswith("N*m") else value for each, value in pairs))


# What of a load's network is written as it is.
TOLD = (*REQUIRED, "command_unit", "covariance_names", "covariance")


# What an in-situ experiment took its load for: the one thing in its recording that its trials alone do not tell.
@dataclass(frozen=True)
class LoadTaken:
    """The load's values, in sentences where they come from, and how many ticks a trial is to have."""

    machine: Machine
    said: tuple[str, ...]
    ticks: int

    def as_text(self) -> str:
        """For an event; :meth:`of_text` reads it to the last digit."""
        network = self.machine.network
        return json.dumps(
            {
                "network": {name: getattr(network, name) for name in TOLD},
                "terms": [term_as_json(term, network.command_unit) for term in network.terms],
                "command_delay_s": self.machine.command_delay_s,
                "motion_delay_s": self.machine.motion_delay_s,
                "said": self.said,
                "ticks": self.ticks,
            },
            ensure_ascii=False,
        )

    @classmethod
    def of_text(cls, text: str) -> "LoadTaken":
        """Raises ExperimentError for what :meth:`as_text` has not written."""
        try:
            data: dict[str, Any] = json.loads(text)
            terms = tuple(read_term("load", each) for each in data.get("terms", ()))
            values = {name: _tuples(value) for name, value in data["network"].items()}
            network = NortonNetwork(**values, terms=terms)
            machine = Machine(network, data["command_delay_s"], data["motion_delay_s"])
            return cls(machine, tuple(data["said"]), int(data["ticks"]))
        except (ValueError, KeyError, TypeError, UsageError) as error:
            raise ExperimentError(f"what the load was taken for cannot be read: {error!r}") from error


def _tuples(value: Any) -> Any:
    """JSON has lists where a network has tuples."""
    return tuple(_tuples(each) for each in value) if isinstance(value, list) else value


def load_taken(events: Sequence[Event]) -> LoadTaken | None:
    """What was said last; None where nothing was."""
    texts = [event.text for event in events if event.kind == LOAD_TAKEN]
    return LoadTaken.of_text(texts[-1]) if texts else None


@dataclass(frozen=True, eq=False)
class Trial:
    """What was seen of one trial, the load torque that was sent, and the torque that the load tells: (ticks,)."""

    seen: TickReadings
    load_torque_nm: FloatArray
    torque_nm: FloatArray

    @classmethod
    def of(cls, measured: Measured, segment: SegmentInfo, load: LoadTaken, tick_s: float) -> "Trial":
        """Raises ExperimentError where a stream has gaps in it."""
        result = readings_at_ticks(measured, segment, load.ticks, tick_s)
        load_torque_nm = sent_at_ticks(measured, segment, "load_torque_nm", load.ticks, tick_s)
        return cls.by_load(result, load_torque_nm, load.machine, tick_s)

    @classmethod
    def by_load(cls, seen: TickReadings, load_torque_nm: FloatArray, load: Machine, tick_s: float) -> "Trial":
        return cls(seen, load_torque_nm, -load.torque_nm(load_torque_nm, seen.load_position_rad, tick_s))

    def by(self, load: Machine, tick_s: float) -> "Trial":
        """The same, if the load had these values."""
        return self.by_load(self.seen, self.load_torque_nm, load, tick_s)


# Any number will do; with this one the numbers look like torques.
TWIST_NM_RAD = 100.0
# A load's inertia that is not told better than this is not told.
LOOSEST = 0.05


# An actuator that stays assembled to its load, without a torque sensor: both machines from their two encoders.
#
# The shaft between them twists in proportion to the torque. How stiff it is nobody knows, and the load's values need
# not know: its own command sets the scale. So the twist, times any number, is fitted as the load's port torque, and
# all is divided by the torque gain that comes out: the load's values in newton metres *as its drive counts them*.
#
# Viscous damping is the exception. A twist that goes with velocity is also what two encoders show that are read half
# a microsecond apart, so that one must be known from elsewhere.
#
# With the load known, the port torque follows from its motion and its command, and the actuator is fitted to that.
@dataclass(frozen=True)
class LoadByTwist:
    """The load in newton metres as its drive counts them, the relative deviation of its inertia there, and what the
    weight of an arm on it gives at most, 0 where none hangs there: ``machine`` is the load without it.
    """

    machine: Machine
    inertia_deviation: float
    weight_nm: float = 0.0


def load_by_twist(measured: Measured, tick_s: float) -> LoadByTwist:
    """The load, from segments in which both machines were shaken (Use.CALIBRATE), each in its own way.

    Raises ExperimentError where the shaft twists too little to tell the load's inertia from the actuator's.
    """
    twisted = signals(with_twist(clean(measured).measured), tick_s, Use.CALIBRATE, Port.LOAD)
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
    cleaned = with_torque_of(clean(measured).measured, load, tick_s)
    return fit_signals(signals(cleaned, tick_s, Use.CALIBRATE, Port.ACTUATOR), command_unit=command_unit)


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
