"""The bench moved by hand as a session like any other: the same drivers, loop, guard, stop and recording."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.jog.hands import DEVICE, NAME, Bounds, Hand, LoadDoes, Setpoints
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.excitations import TORQUE_SHARE
from norton_bench.procedures.knowledge import Knowledge, Plan
from norton_bench.procedures.tare import TareProcedure
from norton_bench.procedures.waves import UNENDING, ticks_in
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import PRESCRIBED_MOTION, ZERO_TORQUE, LoadMode, Segment, Use
from norton_bench.session.script import ByHand, Remark, Script, SoFar
from norton_drivers.readings import DeviceIdentity
from norton_drivers.wiring import DeviceSettings

# A key takes effect with the next segment, and the drives wait for the session between two segments. So segments are
# short for the operator, and long enough that the loop hardly ever waits.
SEGMENT_S = 0.2
# The shortest time from zero to the greatest command, torque or speed: long enough to see the motion and to react
# (0.2 s to see it and 0.2 s for the key: a simple reaction; the rest is margin).
RAMP_S = 1.0
# Share of the rig's limit of rate: at the limit itself, rounding would make the guard clip single ticks.
BELOW = 1 - 1e-6
MODES = {
    LoadDoes.COAST: LoadMode.UNDRIVEN,
    LoadDoes.TORQUE: LoadMode.TORQUE,
    LoadDoes.VELOCITY: LoadMode.ADMITTANCE,
    LoadDoes.ZERO_TORQUE: LoadMode.ADMITTANCE,
    LoadDoes.BODY: LoadMode.ADMITTANCE,
}


@dataclass
class Course:
    """``at`` are the last setpoints that were commanded; ``known`` limits the acceleration of the load."""

    bounds: Bounds
    known: Knowledge
    at: Setpoints = field(default_factory=Setpoints)
    elapsed_s: float = field(default=0.0, init=False)
    too_fast: bool = field(default=False, init=False)
    _load_velocity_rad_s: float = field(default=0.0, init=False)

    def towards(self, wanted: Setpoints) -> Segment:
        """The next segment towards ``wanted``, which must be within bounds; towards zero while the shaft is too
        fast."""
        wanted, tick_s = wanted.zeroed() if self.too_fast else wanted, self.known.tick_s
        ticks = ticks_in(SEGMENT_S, tick_s)
        if self.at.load is LoadDoes.BODY and wanted.at_zero and self.at.command != 0.0:
            # What the actuator pushes against goes last: alone, it would fling the shaft.
            wanted = replace(wanted, load=LoadDoes.BODY, law=self.at.law)
        if wanted.load is not self.at.load:
            # An imposed motion starts at the present velocity of the shaft.
            turning = wanted.load is LoadDoes.VELOCITY
            self.at = replace(self.at, load=wanted.load, load_value=self._load_velocity_rad_s if turning else 0.0)
        self.at = replace(self.at, law=wanted.law)
        segment = Segment(
            NAME,
            wanted.words(self.bounds.command_unit),
            Use.PREPARE,
            approach(self.at.command, wanted.command, self._command_rate_per_s * tick_s, ticks),
            MODES[wanted.load],
            stop_at_velocity_rad_s=UNENDING if self.too_fast else self.bounds.speed_rad_s,
        )
        load = approach(self.at.load_value, wanted.load_value, self._load_rate_per_s * tick_s, ticks)
        if wanted.load is LoadDoes.TORQUE:
            return replace(segment, load_torque_nm=load)
        if wanted.load is LoadDoes.VELOCITY:
            return self._imposed(segment, load)
        return replace(segment, admittance=wanted.law if wanted.load is LoadDoes.BODY else ZERO_TORQUE)

    def went(self, segment: Segment, measured: Measured) -> None:
        """Take the measurements of a finished ``segment``. If the shaft was too fast, all torques go to zero at
        once."""
        last = measured.ticks[-1]
        self.elapsed_s += len(measured.ticks) * self.known.tick_s
        velocity_rad_s = float(last["load_velocity_rad_s"])
        self._load_velocity_rad_s = velocity_rad_s if np.isfinite(velocity_rad_s) else 0.0
        self.too_fast = bool(abs(last["velocity_rad_s"]) >= self.bounds.speed_rad_s)
        # A segment ends early for no other reason.
        turns = segment.velocity_rad_s if segment.mode is LoadMode.ADMITTANCE else segment.load_torque_nm
        index = len(measured.ticks) - 1 if self.too_fast else -1
        self.at = replace(
            self.at, command=float(segment.command[index]), load_value=float(turns[index]) if len(turns) else 0.0
        )
        if self.too_fast:
            held = self.at.load_value if self.at.load is LoadDoes.VELOCITY else 0.0
            self.at = replace(self.at, command=0.0, load_value=held)

    def _imposed(self, segment: Segment, velocity_rad_s: FloatArray) -> Segment:
        tick_s = self.known.tick_s
        return replace(
            segment,
            admittance=PRESCRIBED_MOTION,
            position_rad=np.cumsum(velocity_rad_s) * tick_s,
            velocity_rad_s=velocity_rad_s,
            acceleration_rad_s2=np.diff(velocity_rad_s, prepend=self.at.load_value) / tick_s,
        )

    @property
    def _command_rate_per_s(self) -> float:
        return min(self.bounds.greatest_command / RAMP_S, BELOW * self.known.rig.limits.command_rate_per_s)

    @property
    def _load_rate_per_s(self) -> float:
        calibration = self.known.calibration
        if self.at.load is not LoadDoes.VELOCITY or calibration is None:
            return self.bounds.greatest_load(self.at.load) / RAMP_S
        inertia_kgm2 = calibration.inertia_kgm2 + (calibration.actuator_inertia_kgm2 or calibration.inertia_kgm2)
        spare_rad_s2 = TORQUE_SHARE * self.bounds.load_torque_nm / inertia_kgm2
        return min(self.bounds.velocity_rad_s / RAMP_S, spare_rad_s2)


def approach(start: float, goal: float, step: float, ticks: int) -> FloatArray:
    """From ``start`` (excluded) towards ``goal``, at most ``step`` per tick; shape (ticks,). It ends at goal
    exactly."""
    way = goal - start
    gone = np.minimum(step * np.arange(1, ticks + 1), abs(way))
    return np.where(gone < abs(way), start + np.copysign(gone, way), goal)


def as_it_comes(_bench_s: float) -> None:
    """No pace: without a watcher a simulated bench need not keep to wall time."""


@dataclass
class Pace:
    """Slows a simulated bench down to wall time; a bench in real time never waits for it."""

    _begun_s: float = field(default_factory=time.monotonic)
    _bench_s: float = field(default=0.0, init=False)

    def __call__(self, bench_s: float) -> None:
        """Wait after ``bench_s`` of bench time."""
        self._bench_s += bench_s
        ahead_s = self._bench_s - (time.monotonic() - self._begun_s)
        if ahead_s > 0:
            time.sleep(ahead_s)
        else:
            self._begun_s -= ahead_s  # a delay is not made up for


@dataclass(frozen=True)
class JogScript:
    """Commands the setpoints of ``hand``, and calibrates the load when it asks for that."""

    bounds: Bounds
    hand: Hand
    pace: Callable[[float], None] = as_it_comes
    place: ClassVar[str] = NAME

    def __call__(self, so_far: SoFar) -> Script:
        for sentence in introductions(so_far.known.rig, so_far.devices):
            yield Remark(sentence)
        while True:
            if self.hand.calibrates:
                yield from self._calibrate()
            yield ByHand(NAME, self.plan)
            if not self.hand.calibrates:
                return

    def _calibrate(self) -> Script:
        try:
            yield TareProcedure()
            yield CalibrateProcedure()
        except ExperimentError as error:
            self.hand.could_not_calibrate(str(error))

    def plan(self, known: Knowledge) -> Plan:
        """Segments, until the hand leaves and everything is at zero."""
        self.hand.begin(known.calibration)
        course = Course(self.bounds, known)
        while True:
            wanted, before = self.hand.wanted(course.elapsed_s), course.elapsed_s
            if self.hand.leaves and course.at.at_zero and wanted.load is course.at.load:
                return
            was_too_fast, segment = course.too_fast, course.towards(wanted)
            course.went(segment, (yield segment))
            if course.too_fast and not was_too_fast:
                self.hand.let_go(
                    f"the shaft reached {self.bounds.speed_rad_s:.4g} rad/s, so torques are switched off "
                    "; --speed allows more"
                )
            self.pace(course.elapsed_s - before)


def introductions(rig: Rig, devices: tuple[DeviceIdentity, ...]) -> Iterator[str]:
    """A sentence for each device: the identity that it reports, and its options in the rig file."""
    wiring = rig.wiring
    # In the order of the identities.
    fitted = (wiring.actuator, wiring.load, wiring.modulator, wiring.torque_sensor, *wiring.sensors)
    present = [each for each in fitted if each]
    for settings, identity in zip(present, devices, strict=True):
        yield f"{DEVICE}{settings.role}: {identity.words}; {_options(settings)}"


def _options(settings: DeviceSettings) -> str:
    options = {"direction": settings.direction, **settings.options}
    return ", ".join(f"{name} {value}" for name, value in options.items())
