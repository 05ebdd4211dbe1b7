"""What a session tells its loop as it learns."""

from dataclasses import dataclass

from norton_bench.control.calibration import LoadCalibration
from norton_bench.guard.known import NOTHING_KNOWN, Known


@dataclass(frozen=True)
class Learned:
    """``guard`` is for its checks; None stands for what is not known yet, and leaves things as they are."""

    guard: Known = NOTHING_KNOWN
    torque_bias_nm: float | None = None
    calibration: LoadCalibration | None = None
