"""The bench at rest: bias, noise and ages; and pushes, which show the signs of every device."""

from collections.abc import Generator, Iterator
from dataclasses import dataclass, field, replace
from math import log
from typing import ClassVar

import numpy as np

from norton_bench.errors import ExperimentError
from norton_bench.procedures.knowledge import Knowledge, Plan, Tare
from norton_bench.procedures.options import RestOptions, TareOptions
from norton_bench.procedures.servo_room import greatest_step
from norton_bench.procedures.waves import back, coasting, growth, hold, pushed
from norton_bench.records import Measured, join
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use

# A response greater than this many deviations is not noise.
SIGNIFICANT = 5.0


@dataclass(frozen=True)
class SensorResponse:
    """The response of the torque sensor to pushes, at the greatest of them, with its deviation; all in N m.

    ``noise_nm`` is that of one reading at rest.
    """

    torque_nm: float
    deviation_nm: float
    noise_nm: float

    @property
    def tells(self) -> bool:
        """Whether it is more than noise."""
        return abs(self.torque_nm) > SIGNIFICANT * self.deviation_nm


def sensor_response(pushes: Measured, rest: Measured) -> SensorResponse:
    """The change from ``rest`` in proportion to the command in ``pushes``: least squares over all readings."""
    still = rest.torque["torque_nm"][rest.torque["valid"]]
    readings = pushes.torque[pushes.torque["valid"]]
    commanded = pushes.ticks["command"] if np.any(pushes.ticks["command"]) else pushes.ticks["load_torque_nm"]
    share = np.interp(readings["arrival_ns"], pushes.ticks["tick_ns"], np.abs(commanded)) / max(
        np.max(np.abs(commanded)), 1e-300
    )
    # A sensor with a coarse step may not change at rest: then its step is its noise.
    levels = np.unique(np.concatenate([still, readings["torque_nm"]]))
    step_nm = float(np.min(np.diff(levels))) if levels.size > 1 else 0.0
    noise_nm = float(np.hypot(np.std(still), step_nm / np.sqrt(12)))
    power = max(float(share @ share), 1e-300)
    torque_nm = float(share @ (readings["torque_nm"] - np.mean(still))) / power
    deviation_nm = noise_nm * float(np.sqrt(1 / power + (np.sum(share) / power) ** 2 / still.size))
    return SensorResponse(torque_nm, deviation_nm, noise_nm)


def load_push_faults(measured: Measured, push: Segment, moving_rad_s: float, rest: Measured) -> Iterator[str]:
    """What is wrong after a push by the load: a shaft that does not turn, or wrong signs.

    ``measured`` holds one push like ``push``, or several one after the other; ``rest`` was measured before.
    """
    load, actuator = travel(measured, "load_position_rad"), travel(measured, "position_rad")
    if turned(measured) < moving_rad_s:
        yield (f"the shaft did not turn although the load pushed with {push.load_torque_nm[-1]:.3g} N m; is it locked?")
        return
    if load < 0:
        yield "the load turned against its own torque: repeat its drive's encoder calibration"
    elif actuator < 0:
        yield "load and actuator turned opposite ways: reverse [load] direction in the rig file"
    else:
        yield from torque_sign_faults(measured, rest, expected=-1)


def actuator_push_faults(measured: Measured, push: Segment, moving_rad_s: float, rest: Measured) -> Iterator[str]:
    """The same after a push by the actuator."""
    if turned(measured) < moving_rad_s:
        yield (
            f"the shaft did not turn at the greatest command {push.command[-1]:.3g}; "
            "is it locked, or is [actuator] command limit too low?"
        )
    elif travel(measured, "position_rad") < 0:
        yield "the actuator turned against its command: repeat its drive's encoder calibration"
    else:
        yield from torque_sign_faults(measured, rest, expected=1)


def torque_sign_faults(measured: Measured, rest: Measured, expected: int) -> Iterator[str]:
    """The torque sensor must measure the torque that moved the shaft, with its sign."""
    if not np.any(measured.torque["valid"]) or not np.any(rest.torque["valid"]):
        return
    answer = sensor_response(measured, rest)
    if not answer.tells:
        yield (
            f"the torque sensor does not measure the push: it changed by {1e3 * answer.torque_nm:.2g} mN m ± "
            f"{1e3 * answer.deviation_nm:.2g}; check its axis, coupling and cable. If all are right, its noise hides "
            f"the torque ({1e3 * answer.noise_nm:.2g} mN m a reading): use a smaller range, or let it average"
        )
    elif answer.torque_nm * expected < 0:
        yield (
            "the torque sensor's sign is wrong (torque is what the actuator exerts on the load): "
            "reverse [torque_sensor] direction in the rig file"
        )


def travel(measured: Measured, column: str) -> float:
    """From the first tick to the last."""
    return float(measured.ticks[column][-1] - measured.ticks[column][0])


def turned(measured: Measured) -> float:
    """The greatest speed of the actuator's shaft."""
    return float(np.max(np.abs(measured.ticks["velocity_rad_s"])))


SEARCH_S = 2.5  # how long a torque grows until the shaft moves
REST_S = 0.3
# The shaft moves: it is faster than this share of the velocity limit.
MOVING = 0.03
MOVING_GOAL_SHARE = 0.3  # or, of one that holds a position, than it is at this share of its greatest goal
# Where the torque sensor measured no more than noise: further pushes, to these multiples of that speed. The torque at
# the port grows with it, and every push averages the noise more.
FASTER = (2.0, 4.0, 8.0)
AGAIN = " again"


@dataclass(frozen=True)
class TareProcedure:
    """Rest first, then a push by the load and one by the actuator, each growing until the shaft turns."""

    options: TareOptions = field(default_factory=TareOptions)
    name: ClassVar[str] = "tare"

    def require(self, rig: Rig) -> None:
        """Any rig will do."""

    def duration_s(self, rig: Rig) -> float:
        pushes = 1 if rig.wiring.load is None else 2
        return self.options.duration_s + pushes * (SEARCH_S + REST_S)

    def plan(self, known: Knowledge) -> Plan:
        rig = known.rig
        moving_rad_s = moving_velocity_rad_s(rig)
        rest = yield coasting(self.name, "rest", Use.TARE, hold(0.0, self.options.duration_s, known.tick_s))
        if rig.wiring.load is not None:
            torque_nm = growth(greatest_load_torque(rig), SEARCH_S, known.tick_s)
            push = pushed(self.name, "load pushes", Use.TARE, torque_nm, stop_at_velocity_rad_s=moving_rad_s)
            measured = yield from self._pushes(push, rig, rest)
            _refuse(load_push_faults(measured, push, moving_rad_s, rest))
            yield back(self.name, "after a push", rig, measured, REST_S)
        if rig.wiring.shaft == "clamped" and rig.wiring.load is None:
            return
        command = growth(greatest_step(rig), SEARCH_S, known.tick_s)
        push = coasting(self.name, "actuator pushes", Use.TARE, command, stop_at_velocity_rad_s=moving_rad_s)
        measured = yield from self._pushes(push, rig, rest)
        _refuse(actuator_push_faults(measured, push, moving_rad_s, rest))
        yield back(self.name, "after a push", rig, measured, REST_S)

    def _pushes(self, push: Segment, rig: Rig, rest: Measured) -> Generator[Segment, Measured, Measured]:
        """``push``, and faster ones until the torque sensor measures more than noise; returns all measurements."""
        slow = yield push
        measured, last = slow, slow
        readable = np.any(slow.torque["valid"]) and np.any(rest.torque["valid"])
        if not readable or not rig.modelled or turned(slow) < push.stop_at_velocity_rad_s:
            return measured
        for faster in FASTER:
            if sensor_response(measured, rest).tells:
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


def moving_velocity_rad_s(rig: Rig) -> float:
    """From which on the shaft counts as turning."""
    moving_rad_s = MOVING * rig.limits.velocity_rad_s
    if not rig.holds_position:
        return moving_rad_s
    # It follows a goal that grows by this factor a second, and reaches the velocity at a share of its greatest goal.
    return min(moving_rad_s, MOVING_GOAL_SHARE * log(100.0) / SEARCH_S * greatest_step(rig))


def greatest_load_torque(rig: Rig) -> float:
    """The load's own limit, or the port's where it has none."""
    return min(rig.limits.load_torque_nm, rig.limits.torque_nm)


def at_rest(measured: Measured) -> Tare:
    """Bias and noise of the torque sensor."""
    torque = measured.torque["torque_nm"][measured.torque["valid"]]
    return Tare(
        torque_bias_nm=float(np.mean(torque)) if len(torque) else 0.0,
        torque_noise_nm=float(np.std(torque)) if len(torque) else 0.0,
    )


def _last(push: Measured | None, column: str) -> float | None:
    """The push that set the shaft in motion."""
    return None if push is None else float(push.ticks[column][-1])


def _refuse(faults: Iterator[str]) -> None:
    """Raises ExperimentError for the first, where there is one."""
    for fault in faults:
        raise ExperimentError(f"tare: {fault}")


# A segment holds all its commands: a long rest is made of many.
PIECE_S = 10.0


@dataclass(frozen=True)
class RestProcedure:
    """Drives enabled, no command, the load coasting: everything is measured and recorded, nothing is fitted."""

    options: RestOptions = field(default_factory=RestOptions)
    name: ClassVar[str] = "rest"

    def require(self, rig: Rig) -> None:
        """Any rig will do."""

    def duration_s(self, rig: Rig) -> float:
        return self.options.duration_s

    def plan(self, known: Knowledge) -> Plan:
        left_s = self.options.duration_s
        while left_s > 0.5 * known.tick_s:
            piece_s = min(left_s, PIECE_S)
            yield coasting(self.name, "rest", Use.PREPARE, hold(0.0, piece_s, known.tick_s))
            left_s -= piece_s

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known
