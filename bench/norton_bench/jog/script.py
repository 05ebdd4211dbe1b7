"""The bench moved by hand as a session like any other: the same drivers, loop, guard, stop and recording."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import ClassVar

from norton_bench.errors import ExperimentError
from norton_bench.jog.course import NAME, Course
from norton_bench.jog.hands import DEVICE, Bounds, Hand
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.knowledge import Knowledge, Plan
from norton_bench.procedures.tare import TareProcedure
from norton_bench.rig.rig import Rig
from norton_bench.session.script import ByHand, Remark, Script, SoFar
from norton_drivers.readings import DeviceIdentity
from norton_drivers.wiring import DeviceSettings


def as_it_comes(_bench_s: float) -> None:
    """Nobody watches: a simulated bench need not keep to wall time."""


@dataclass
class Pace:
    """Holds a simulated bench, which is faster, to wall time. One in wall time is never held up by it."""

    _begun_s: float = field(default_factory=time.monotonic)
    _bench_s: float = field(default=0.0, init=False)

    def __call__(self, bench_s: float) -> None:
        """``bench_s`` more have passed on the bench."""
        self._bench_s += bench_s
        ahead_s = self._bench_s - (time.monotonic() - self._begun_s)
        if ahead_s > 0:
            time.sleep(ahead_s)
        else:
            self._begun_s -= ahead_s  # what was lost is not made up for


@dataclass(frozen=True)
class JogScript:
    """Setpoints as ``hand`` wants them; where it wants the load calibrated, that comes first, or in between."""

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
        self.hand.begin(calibrated=known.calibration is not None)
        course = Course(self.bounds, known)
        while True:
            wanted, before = self.hand.wanted(course.elapsed_s), course.elapsed_s
            if self.hand.leaves and course.at.at_zero and wanted.load is course.at.load:
                return
            was_too_fast, segment = course.too_fast, course.towards(wanted)
            course.went(segment, (yield segment))
            if course.too_fast and not was_too_fast:
                self.hand.let_go(
                    f"the shaft reached {self.bounds.speed_rad_s:.4g} rad/s, at which torques end here: they are back "
                    "at zero; --speed allows more"
                )
            self.pace(course.elapsed_s - before)


def introductions(rig: Rig, devices: tuple[DeviceIdentity, ...]) -> Iterator[str]:
    """Each device in a sentence: who it says to be, and what the rig file tells its driver."""
    wiring = rig.wiring
    # In the order in which devices are asked.
    fitted = (wiring.actuator, wiring.load, wiring.modulator, wiring.torque_sensor, *wiring.sensors)
    present = [each for each in fitted if each]
    for settings, found in zip(present, devices, strict=True):
        yield f"{DEVICE}{settings.role}: {_said(found)}; {_set(settings)}"


def _said(found: DeviceIdentity) -> str:
    hardware = f", hardware {found.hardware}" if found.hardware else ""
    firmware = f", firmware {found.firmware}" if found.firmware else ""
    return f"{found.driver}, {found.address}{hardware}{firmware}"


def _set(settings: DeviceSettings) -> str:
    options = {"direction": settings.direction, **settings.options}
    return ", ".join(f"{name} {value}" for name, value in options.items())
