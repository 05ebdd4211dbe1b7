"""``rig check --move``: a few gentle pushes, and whether every device tells of them alike."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from norton_bench.check.findings import Problem
from norton_bench.check.plausible import push_of, ratio_faults, torque_faults, torque_scales, turned_by, velocity_faults
from norton_bench.errors import ExperimentError
from norton_bench.guard.guard import Guard
from norton_bench.loop.alignment import Alignment
from norton_bench.loop.devices import Devices, open_devices
from norton_bench.loop.loop import Loop, never_stop
from norton_bench.loop.outbox import Outbox
from norton_bench.procedures.directions import actuator_push_faults, load_push_faults, torque_sign_faults
from norton_bench.procedures.makers import coasting, pushed
from norton_bench.procedures.tare import MOVING, REST_S, SEARCH_S, greatest_load_torque
from norton_bench.procedures.waves import growth, hold, ramp
from norton_bench.records import Measured, join
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use
from norton_bench.units import same_dimension
from norton_drivers.backend import Backend
from norton_drivers.punctual import LOOP_PRIORITY, punctual

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
            loop.on_time = partial(punctual, LOOP_PRIORITY)
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
