"""``rig check --move``: a few gentle pushes, and whether all devices report them alike."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from norton_bench.check.survey import Problem
from norton_bench.errors import ExperimentError
from norton_bench.guard.guard import Guard
from norton_bench.loop.devices import Devices, open_devices
from norton_bench.loop.loop import Loop
from norton_bench.loop.outbox import Outbox
from norton_bench.loop.stop_word import never_stop
from norton_bench.procedures.tare import (
    MOVING,
    REST_S,
    SEARCH_S,
    actuator_push_faults,
    greatest_load_torque,
    load_push_faults,
    torque_sign_faults,
)
from norton_bench.procedures.waves import coasting, growth, hold, pushed, ramp
from norton_bench.records import Measured, Table, join
from norton_bench.rig.rig import Rig
from norton_bench.sample import Alignment
from norton_bench.segments import Use
from norton_bench.units import same_dimension
from norton_drivers.ports import Backend
from norton_drivers.real_time import LOOP_PRIORITY, in_real_time

# A drive's velocity filter, and the end of a record that is not quite at rest, account for less than this.
VELOCITY_TOLERANCE = 0.2
# So does the twist of a soft torque sensor between two encoders.
RATIO_TOLERANCE = 0.15
# Motors give what is commanded to within some tenths, and friction varies: only wrong factors are looked for.
TORQUE_TOLERANCE = 0.4
_DRIVE_MEND = "torque constant, gear ratio, rated torque or range table"
_SENSOR_MEND = "scale, range and axis"
# Of the velocity at which a push ends: from here on the whole friction is overcome.
SLIDING = 0.3
_TRAVEL_MIN_RAD = 0.02
_STEPS_MIN = 20  # of an encoder's resolution


# Whether what devices say fits together: each encoder with itself, one with the other, the sensor with the drives.
@dataclass(frozen=True)
class Turned:
    """One drive's encoder over a stretch of motion that begins and ends nearly at rest."""

    role: str
    travel_rad: float
    from_velocity_rad: float  # the integral of the velocity readings
    readable: bool  # whether it turned far enough for the encoder to tell

    @property
    def velocity_scale(self) -> float:
        return self.from_velocity_rad / self.travel_rad


def turned_by(role: str, motion: Table, resolution_rad: float) -> Turned:
    """From the readings of one drive; ``motion`` is a table of :data:`norton_bench.records.MOTION`."""
    position, seconds = motion["position_rad"], motion["arrival_ns"] * 1e-9
    travel = float(position[-1] - position[0]) if len(position) else 0.0
    integral = float(np.trapezoid(motion["velocity_rad_s"], seconds))
    return Turned(role, travel, integral, abs(travel) > max(_TRAVEL_MIN_RAD, _STEPS_MIN * resolution_rad))


def velocity_faults(turned: Turned) -> Iterator[str]:
    """Position and velocity come from one encoder, and must tell of one motion."""
    if turned.readable and not _near(turned.velocity_scale, VELOCITY_TOLERANCE):
        yield (
            f"[{turned.role}] its velocity readings say {turned.velocity_scale:.2f} times what its positions do: "
            "check the scale of both in the drive and the rig file (range table, pole pairs, gear ratio, counts)"
        )


def ratio_faults(actuator: Turned, load: Turned) -> Iterator[str]:
    """One shaft: both encoders must turn equally far."""
    if not (actuator.readable and load.readable):
        return
    ratio = actuator.travel_rad / load.travel_rad
    if not _near(ratio, RATIO_TOLERANCE):
        yield (
            f"[actuator] turned {ratio:.2f} times as far as [load], though they are on one shaft: the position scale "
            "of one of them is wrong (encoder counts, gear ratio, pole pairs, range table), or the coupling slips"
        )


@dataclass(frozen=True)
class Push:
    """What a drive was told while it turned the shaft, and what the sensor felt of it, in magnitudes."""

    told: float  # in the drive's own unit
    felt_nm: float


def push_of(measured: Measured, told: str, at_rest_nm: float, moving_rad_s: float) -> Push:
    """``told`` is the column of the command, ``at_rest_nm`` what the sensor showed before; the sliding part counts."""
    ticks = measured.ticks
    sliding = ticks[np.abs(ticks["velocity_rad_s"]) > SLIDING * moving_rad_s]
    return Push(float(np.mean(np.abs(sliding[told]))), abs(float(np.mean(sliding["torque_nm"])) - at_rest_nm))


@dataclass(frozen=True)
class TorqueScales:
    """What each drive gives of what it is told, by the torque sensor; nan where that cannot be told.

    Whoever turns the shaft overcomes the friction of both sides. Of that the sensor feels the actuator's while the load
    pushes, and the load's while the actuator pushes: together, what either push must have amounted to.
    """

    actuator: float
    load: float


def torque_scales(load: Push, actuator: Push, *, in_newton_metres: bool) -> TorqueScales:
    """``in_newton_metres`` says whether the actuator is told a torque."""
    overcome_nm = load.felt_nm + actuator.felt_nm
    return TorqueScales(overcome_nm / actuator.told if in_newton_metres else float("nan"), overcome_nm / load.told)


def torque_faults(scales: TorqueScales) -> Iterator[str]:
    """Three that must agree on one torque: of a pair that does, neither is wrong."""
    actuator, load = scales.actuator, scales.load
    actuator_right, load_right = _near(actuator, TORQUE_TOLERANCE), _near(load, TORQUE_TOLERANCE)
    if load_right and (actuator_right or np.isnan(actuator)):
        return
    if np.isnan(actuator):
        yield (
            f"[load] gives {load:.2f} times the torque that it is told, by the torque sensor: the scale of one of them "
            f"is wrong (drive: {_DRIVE_MEND}; sensor: {_SENSOR_MEND})"
        )
    elif _near(actuator / load, TORQUE_TOLERANCE):
        shown = (actuator * load) ** 0.5
        yield (
            f"[torque_sensor] shows {shown:.2f} times the torque that [actuator] and [load] agree on: check its "
            f"{_SENSOR_MEND}"
        )
    elif actuator_right or load_right:
        wrong, scale, right = ("actuator", actuator, "load") if load_right else ("load", load, "actuator")
        yield (
            f"[{wrong}] gives {scale:.2f} times the torque that it is told, by [{right}] and [torque_sensor]: check "
            f"its {_DRIVE_MEND}"
        )
    else:
        yield (
            f"[torque_sensor] shows {actuator:.2f} times what [actuator] is told to give and {load:.2f} times what "
            f"[load] is: check the scales of all three (drives: {_DRIVE_MEND}; sensor: {_SENSOR_MEND})"
        )


def _near(ratio: float, tolerance: float) -> bool:
    """Whether ``ratio`` is 1 within ``tolerance``, the same either way."""
    return 1 / (1 + tolerance) <= ratio <= 1 + tolerance


NAME = "check"
# Of what the rig allows: enough to overcome friction, and no more.
SHARE = 0.5
WINDOW_RAD = 4 * np.pi
CLAMPED_S = 1.0


@dataclass(frozen=True)
class Moved:
    """What moving the shaft has shown: ``said`` is worth reading even where nothing is wrong."""

    said: tuple[str, ...]
    problems: tuple[Problem, ...]


def gentle(rig: Rig) -> Rig:
    """The rig with limits for a first motion."""
    limits = replace(
        rig.limits,
        position_rad=min(rig.limits.position_rad, WINDOW_RAD),
        load_torque_nm=SHARE * greatest_load_torque(rig),
    )
    return replace(rig, limits=limits, command=replace(rig.command, limit=SHARE * rig.command.limit))


def announcement(rig: Rig) -> str:
    """What is about to happen to the shaft, with its bounds."""
    mild = gentle(rig)
    torques = [f"{mild.command.limit:.3g} {mild.command.unit} from the actuator"]
    if rig.wiring.load is not None:
        torques.append(f"{mild.limits.load_torque_nm:.3g} N*m from the load")
    return (
        f"moving: pushes that grow to at most {' and '.join(torques)}, each until the shaft turns at "
        f"{moving_rad_s(mild):.3g} rad/s, within {mild.limits.position_rad:.3g} rad of where it stands"
    )


def moving_rad_s(rig: Rig) -> float:
    """Motion that counts as such."""
    return MOVING * rig.limits.velocity_rad_s


def check_moving(rig: Rig, backend: Backend, stop_request: Callable[[], str | None] = never_stop) -> Moved:
    """See the watchdogs act, push, and judge. The drives are idle afterwards, however it ends.

    Raises SafetyStopError, OperatorStopError, DeviceError, ExperimentError.
    """
    mild = gentle(rig)
    devices = open_devices(mild, backend)
    try:
        # Its limits alone: that signals contradict each other is what is to be found out here.
        guard = Guard(
            mild.limits, mild.command.limit, mild.tick_s, devices.load is not None, devices.torque_sensor is not None
        )
        loop = Loop(devices, guard, Outbox(), Alignment(), mild.tick_ns, stop_request)
        if not backend.lock_step:
            loop.on_time = partial(in_real_time, LOOP_PRIORITY)
        pushes = _Pushes(mild, devices, loop)
        devices.await_streams()
        pushes.said += map(str, devices.verify_watchdogs())
        with loop.running():
            pushes.perform()
        return Moved(
            tuple(dict.fromkeys(pushes.said)), tuple(ExperimentError(fault) for fault in dict.fromkeys(pushes.faults))
        )
    finally:
        devices.link.close()


@dataclass
class _Pushes:
    """The pushes of one check, in order; a later one is left out where an earlier one shows that it could run away."""

    rig: Rig
    devices: Devices
    loop: Loop
    said: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def perform(self) -> None:
        rest = self._rest()
        if self.rig.wiring.shaft == "clamped" and self.devices.load is None:
            self._push_against_the_clamp(rest)
            return
        by_load = self._push_with_the_load(rest) if self.devices.load is not None else None
        by_actuator = self._push_with_the_actuator(rest) if not self.faults else None
        if by_load is not None and by_actuator is not None and not self.faults:
            self._compare_torques(rest, by_load, by_actuator)

    def _push_with_the_load(self, rest: Measured) -> Measured:
        torque_nm = growth(self.rig.limits.load_torque_nm, SEARCH_S, self.rig.tick_s)
        push = pushed(NAME, "load pushes", Use.TARE, torque_nm, stop_at_velocity_rad_s=moving_rad_s(self.rig))
        measured = self.loop.run(push)
        self._judge("the load", measured, list(load_push_faults(measured, push, moving_rad_s(self.rig), rest)))
        return measured

    def _push_with_the_actuator(self, rest: Measured) -> Measured:
        command = growth(self.rig.command.limit, SEARCH_S, self.rig.tick_s)
        push = coasting(NAME, "actuator pushes", Use.TARE, command, stop_at_velocity_rad_s=moving_rad_s(self.rig))
        measured = self.loop.run(push)
        self._judge("the actuator", measured, list(actuator_push_faults(measured, push, moving_rad_s(self.rig), rest)))
        return measured

    def _push_against_the_clamp(self, rest: Measured) -> None:
        command = ramp(0.0, self.rig.command.limit, CLAMPED_S, self.rig.tick_s)
        measured = self.loop.run(coasting(NAME, "actuator pushes", Use.TARE, command))
        self.faults += torque_sign_faults(measured, rest, expected=1)
        self.said.append("the shaft is clamped: of directions, only the torque sensor's can be seen")

    def _judge(self, who: str, push: Measured, faults: list[str]) -> None:
        """Signs first: a wrong scale is told only of a shaft that turns the right way."""
        motion = join([push, self._rest()])
        self.faults += faults
        if not faults:
            self.said.append(f"{who} turned the shaft the right way")
            self.faults += self._scale_faults(motion)

    def _scale_faults(self, motion: Measured) -> Iterator[str]:
        actuator = turned_by("actuator", motion.motion, self.devices.actuator.position_resolution_rad)
        yield from velocity_faults(actuator)
        if self.devices.load is not None:
            load = turned_by("load", motion.load_motion, self.devices.load.position_resolution_rad)
            yield from velocity_faults(load)
            yield from ratio_faults(actuator, load)

    def _compare_torques(self, rest: Measured, by_load: Measured, by_actuator: Measured) -> None:
        at_rest_nm = float(np.mean(rest.ticks["torque_nm"]))
        scales = torque_scales(
            push_of(by_load, "load_torque_nm", at_rest_nm, moving_rad_s(self.rig)),
            push_of(by_actuator, "command", at_rest_nm, moving_rad_s(self.rig)),
            in_newton_metres=same_dimension(self.rig.command.unit, "N*m"),
        )
        self.said.append(f"by the torque sensor, the load gives about {scales.load:.2f} of what it is told")
        if np.isfinite(scales.actuator):
            self.said.append(f"by the torque sensor, the actuator gives about {scales.actuator:.2f} of what it is told")
        self.faults += torque_faults(scales)

    def _rest(self) -> Measured:
        return self.loop.run(coasting(NAME, "rest", Use.PREPARE, hold(0.0, REST_S, self.rig.tick_s)))
