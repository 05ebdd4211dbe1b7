"""What a session tells its loop as it learns."""

from dataclasses import dataclass

from norton_bench.control.calibration import LoadCalibration
from norton_bench.guard.model import EMPTY_MODEL, GuardModel


@dataclass(frozen=True)
class Learned:
    """``guard`` is for its checks; None stands for what is not known yet, and leaves things as they are."""

    guard: GuardModel = EMPTY_MODEL
    torque_bias_nm: float | None = None
    calibration: LoadCalibration | None = None
