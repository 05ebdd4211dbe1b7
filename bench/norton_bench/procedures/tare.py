"""The bench at rest, and which way is which: bias, noise, ages, and the signs of every device."""

from collections.abc import Generator, Iterator
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from norton_bench.errors import ExperimentError
from norton_bench.procedures.directions import actuator_push_faults, felt, load_push_faults, turned
from norton_bench.procedures.knowledge import Knowledge, Plan, Tare
from norton_bench.procedures.makers import back, coasting, pushed
from norton_bench.procedures.options import TareOptions
from norton_bench.procedures.waves import growth, hold
from norton_bench.records import Measured, join
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use

SEARCH_S = 2.5  # how long a torque grows in search of motion
REST_S = 0.3
# Motion that counts as such: this share of the velocity limit.
MOVING = 0.03
# Where the torque sensor tells nothing yet: further pushes, to so many times that speed. The torque at the port grows
# with it, and every push averages more of the noise.
FASTER = (2.0, 4.0, 8.0)
AGAIN = " again"


@dataclass(frozen=True)
class TareProcedure:
    """Rest first, then a push from the load and one from the actuator, each grown until the shaft turns."""

    options: TareOptions = field(default_factory=TareOptions)
    name: ClassVar[str] = "tare"

    def require(self, rig: Rig) -> None:
        """Any rig will do."""

    def duration_s(self, rig: Rig) -> float:
        pushes = 1 if rig.wiring.load is None else 2
        return self.options.duration_s + pushes * (SEARCH_S + REST_S)

    def plan(self, known: Knowledge) -> Plan:
        rig = known.rig
        moving_rad_s = MOVING * rig.limits.velocity_rad_s
        rest = yield coasting(self.name, "rest", Use.TARE, hold(0.0, self.options.duration_s, known.tick_s))
        if rig.wiring.load is not None:
            torque_nm = growth(greatest_load_torque(rig), SEARCH_S, known.tick_s)
            push = pushed(self.name, "load pushes", Use.TARE, torque_nm, stop_at_velocity_rad_s=moving_rad_s)
            measured = yield from self._pushes(push, rig, rest)
            _refuse(load_push_faults(measured, push, moving_rad_s, rest))
            yield back(self.name, "after a push", rig, measured, REST_S)
        if rig.wiring.shaft == "clamped" and rig.wiring.load is None:
            return
        command = growth(rig.command.limit, SEARCH_S, known.tick_s)
        push = coasting(self.name, "actuator pushes", Use.TARE, command, stop_at_velocity_rad_s=moving_rad_s)
        measured = yield from self._pushes(push, rig, rest)
        _refuse(actuator_push_faults(measured, push, moving_rad_s, rest))
        yield back(self.name, "after a push", rig, measured, REST_S)

    def _pushes(self, push: Segment, rig: Rig, rest: Measured) -> Generator[Segment, Measured, Measured]:
        """``push``, and faster ones until the torque sensor tells more than noise; all that was measured in them."""
        slow = yield push
        measured, last = slow, slow
        readable = np.any(slow.torque["valid"]) and np.any(rest.torque["valid"])
        if not readable or not rig.modelled or turned(slow) < push.stop_at_velocity_rad_s:
            return measured
        for faster in FASTER:
            if felt(measured, rest).tells:
                break
            yield back(self.name, "after a push", rig, last, REST_S)
            stop_rad_s = faster * push.stop_at_velocity_rad_s
            last = yield replace(push, name=push.name + AGAIN, stop_at_velocity_rad_s=stop_rad_s)
            measured = join([measured, last])
        return measured

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        parts = {segment.name: measured.between(segment.start_ns, segment.end_ns) for segment in measured.segments}
        tare = replace(
            at_rest(parts["rest"]),
            moving_command=_last(parts.get("actuator pushes"), "command"),
            moving_load_nm=_last(parts.get("load pushes"), "load_torque_nm"),
        )
        return replace(known, tare=tare)


def greatest_load_torque(rig: Rig) -> float:
    """The load's own limit, or the port's where it has none."""
    return min(rig.limits.load_torque_nm, rig.limits.torque_nm)


def at_rest(measured: Measured) -> Tare:
    """Bias and noise of the torque sensor, and the median age of each stream."""
    torque = measured.torque["torque_nm"][measured.torque["valid"]]
    ticks = measured.ticks
    return Tare(
        torque_bias_nm=float(np.mean(torque)) if len(torque) else 0.0,
        torque_noise_nm=float(np.std(torque)) if len(torque) else 0.0,
        torque_age_s=float(np.median(ticks["torque_age_ns"])) * 1e-9,
        motion_age_s=float(np.median(ticks["motion_age_ns"])) * 1e-9,
        load_motion_age_s=float(np.median(ticks["load_motion_age_ns"])) * 1e-9,
    )


def _last(push: Measured | None, column: str) -> float | None:
    """The push that set the shaft in motion."""
    return None if push is None else float(push.ticks[column][-1])


def _refuse(faults: Iterator[str]) -> None:
    """Raises ExperimentError for the first, where there is one."""
    for fault in faults:
        raise ExperimentError(f"tare: {fault}")
