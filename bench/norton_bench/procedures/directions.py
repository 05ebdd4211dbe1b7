"""Which way is which: what a push tells of the signs of every device, in sentences with the mend."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from norton_bench.records import Measured
from norton_bench.segments import Segment

# An answer beyond so many deviations is no accident.
SIGNIFICANT = 5.0


@dataclass(frozen=True)
class Felt:
    """What the torque sensor felt of pushes, at the greatest of them, as a multiple of what was told; all in N m.

    ``noise_nm`` is that of one reading at rest. The sign is the torque's own.
    """

    torque_nm: float
    deviation_nm: float
    noise_nm: float

    @property
    def tells(self) -> bool:
        """Whether it is more than noise."""
        return abs(self.torque_nm) > SIGNIFICANT * self.deviation_nm


def felt(pushes: Measured, rest: Measured) -> Felt:
    """The change from ``rest`` that goes with what one drive was told in ``pushes``: least squares, by all readings."""
    still = rest.torque["torque_nm"][rest.torque["valid"]]
    readings = pushes.torque[pushes.torque["valid"]]
    told = pushes.ticks["command"] if np.any(pushes.ticks["command"]) else pushes.ticks["load_torque_nm"]
    share = np.interp(readings["arrival_ns"], pushes.ticks["tick_ns"], np.abs(told)) / max(np.max(np.abs(told)), 1e-300)
    # A sensor that counts coarsely may stand still at rest: its step is then its noise.
    levels = np.unique(np.concatenate([still, readings["torque_nm"]]))
    step_nm = float(np.min(np.diff(levels))) if levels.size > 1 else 0.0
    noise_nm = float(np.hypot(np.std(still), step_nm / np.sqrt(12)))
    power = max(float(share @ share), 1e-300)
    torque_nm = float(share @ (readings["torque_nm"] - np.mean(still))) / power
    deviation_nm = noise_nm * float(np.sqrt(1 / power + (np.sum(share) / power) ** 2 / still.size))
    return Felt(torque_nm, deviation_nm, noise_nm)


def load_push_faults(measured: Measured, push: Segment, moving_rad_s: float, rest: Measured) -> Iterator[str]:
    """What is wrong where the load pushed: the shaft that does not turn, or the signs that are wrong.

    ``measured`` holds one push like ``push``, or several one after the other; ``rest`` is from before.
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
    """The same where the actuator pushed."""
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
    """The torque that moved the shaft must show at the port, with its sign."""
    if not np.any(measured.torque["valid"]) or not np.any(rest.torque["valid"]):
        return
    answer = felt(measured, rest)
    if not answer.tells:
        yield (
            f"the torque sensor does not feel the push: it changed by {1e3 * answer.torque_nm:.2g} mN m, give or take "
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
