"""The bench at rest, and which way is which: bias, noise, ages, and the signs of every device."""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from bench.errors import ExperimentError
from bench.procedures.knowledge import Knowledge, Plan, Tare
from bench.procedures.makers import coasting, pushed
from bench.procedures.options import TareOptions
from bench.procedures.waves import growth, hold
from bench.records import Measured
from bench.rig.rig import Rig
from bench.segments import Segment, Use

SEARCH_S = 2.5  # how long a torque grows in search of motion
REST_S = 0.3
# Motion that counts as such: this share of the velocity limit.
MOVING = 0.03


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
        rest = coasting(self.name, "after a push", Use.PREPARE, hold(0.0, REST_S, known.tick_s))
        yield coasting(self.name, "rest", Use.TARE, hold(0.0, self.options.duration_s, known.tick_s))
        if rig.wiring.load is not None:
            torque_nm = growth(greatest_load_torque(rig), SEARCH_S, known.tick_s)
            push = pushed(self.name, "load pushes", Use.TARE, torque_nm, stop_at_velocity_rad_s=moving_rad_s)
            check_load_push((yield push), push, moving_rad_s)
            yield rest
        if rig.wiring.shaft == "clamped" and rig.wiring.load is None:
            return
        command = growth(rig.command.limit, SEARCH_S, known.tick_s)
        push = coasting(self.name, "actuator pushes", Use.TARE, command, stop_at_velocity_rad_s=moving_rad_s)
        check_actuator_push((yield push), push, moving_rad_s)
        yield rest

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        rest = next(segment for segment in measured.segments if segment.name == "rest")
        return replace(known, tare=at_rest(measured.between(rest.start_ns, rest.end_ns)))


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


def check_load_push(measured: Measured, push: Segment, moving_rad_s: float) -> None:
    """Raises ExperimentError naming the sign that is wrong, or the shaft that does not turn."""
    load, actuator = travel(measured, "load_position_rad"), travel(measured, "position_rad")
    if turned(measured) < moving_rad_s:
        raise ExperimentError(
            f"tare: the shaft did not turn although the load pushed with {push.load_torque_nm[-1]:.3g} N m; "
            "is it locked?"
        )
    if load < 0:
        raise ExperimentError("tare: the load turned against its own torque: repeat its drive's encoder calibration")
    if actuator < 0:
        raise ExperimentError("tare: load and actuator turned opposite ways: reverse [load] direction in the rig file")
    check_torque_sign(measured, expected=-1)


def check_actuator_push(measured: Measured, push: Segment, moving_rad_s: float) -> None:
    """Raises ExperimentError naming the sign that is wrong, or the shaft that does not turn."""
    if turned(measured) < moving_rad_s:
        raise ExperimentError(
            f"tare: the shaft did not turn at the greatest command {push.command[-1]:.3g}; "
            "is it locked, or is [actuator] command limit too low?"
        )
    if travel(measured, "position_rad") < 0:
        raise ExperimentError("tare: the actuator turned against its command: repeat its drive's encoder calibration")
    check_torque_sign(measured, expected=1)


def check_torque_sign(measured: Measured, expected: int) -> None:
    """The torque that moved the shaft must show at the port, with its sign. Raises ExperimentError."""
    torque = measured.torque["torque_nm"]
    if not len(torque):
        return
    # What the push changed: its last twentieth against its first, when the torque was still next to nothing.
    part = max(1, len(torque) // 20)
    change, noise = torque[-part:].mean() - torque[:part].mean(), torque[:part].std() / np.sqrt(part)
    if change * expected < 0 and abs(change) > 5 * noise:
        raise ExperimentError(
            "tare: the torque sensor's sign is wrong (torque is what the actuator exerts on the load): "
            "reverse [torque_sensor] direction in the rig file"
        )
    if abs(change) <= 5 * noise:
        raise ExperimentError("tare: the torque sensor does not feel the push: check its axis, coupling and cable")


def travel(measured: Measured, column: str) -> float:
    """From the first tick to the last."""
    return float(measured.ticks[column][-1] - measured.ticks[column][0])


def turned(measured: Measured) -> float:
    """The greatest speed of the actuator's shaft."""
    return float(np.max(np.abs(measured.ticks["velocity_rad_s"])))
