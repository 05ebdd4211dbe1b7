"""Which way is which: what a push tells of the signs of every device, in sentences with the mend."""

from collections.abc import Iterator

import numpy as np

from bench.records import Measured
from bench.segments import Segment


def load_push_faults(measured: Measured, push: Segment, moving_rad_s: float) -> Iterator[str]:
    """What is wrong where the load pushed: the shaft that does not turn, or the signs that are wrong."""
    load, actuator = travel(measured, "load_position_rad"), travel(measured, "position_rad")
    if turned(measured) < moving_rad_s:
        yield (f"the shaft did not turn although the load pushed with {push.load_torque_nm[-1]:.3g} N m; is it locked?")
        return
    if load < 0:
        yield "the load turned against its own torque: repeat its drive's encoder calibration"
    elif actuator < 0:
        yield "load and actuator turned opposite ways: reverse [load] direction in the rig file"
    else:
        yield from torque_sign_faults(measured, expected=-1)


def actuator_push_faults(measured: Measured, push: Segment, moving_rad_s: float) -> Iterator[str]:
    """What is wrong where the actuator pushed: the shaft that does not turn, or the signs that are wrong."""
    if turned(measured) < moving_rad_s:
        yield (
            f"the shaft did not turn at the greatest command {push.command[-1]:.3g}; "
            "is it locked, or is [actuator] command limit too low?"
        )
    elif travel(measured, "position_rad") < 0:
        yield "the actuator turned against its command: repeat its drive's encoder calibration"
    else:
        yield from torque_sign_faults(measured, expected=1)


def torque_sign_faults(measured: Measured, expected: int) -> Iterator[str]:
    """The torque that moved the shaft must show at the port, with its sign."""
    torque = measured.torque["torque_nm"]
    if not len(torque):
        return
    # What the push changed: its last twentieth against its first, when the torque was still next to nothing.
    part = max(1, len(torque) // 20)
    change, noise = torque[-part:].mean() - torque[:part].mean(), torque[:part].std() / np.sqrt(part)
    if abs(change) <= 5 * noise:
        yield "the torque sensor does not feel the push: check its axis, coupling and cable"
    elif change * expected < 0:
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
