"""What a servo takes off its command: the angle of its shaft or nothing of it, and the velocity by two angles."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification import loops
from norton_bench.identification.kernels import Kernel
from norton_bench.identification.shape import GAIN, INERTIA, VISCOUS
from norton_drivers.servo import Servo

# Beyond this share of its limit, as the drive has it, a servo counts as at its limit: its scale is off by a few per
# cent, and the angle by counts.
NEAR_LIMIT = 0.85


def fed_back(servo: Servo, angle_later_by: Callable[[float], FloatArray]) -> FloatArray:
    """Of an angle that it is given as so much later [s], shape (n,): in the unit of its command."""
    now = angle_later_by(servo.delay_s)
    before = angle_later_by(servo.delay_s + servo.window_s)
    return servo.of_angle * now + servo.of_velocity / servo.window_s * (now - before)


def fed_back_of(servo: Servo, angle_rad: FloatArray, step_s: float, later_s: float = 0.0) -> FloatArray:
    """The same at each sample of an angle (n,) every ``step_s``, as it is ``later_s`` later."""
    from norton_bench.models import servo_steps  # noqa: PLC0415  (compiled: slow to import)

    return fed_back(servo, lambda late_s: servo_steps.shifted(angle_rad, (later_s - late_s) / step_s))


def near_limit(
    servo: Servo, sent_s: FloatArray, command: FloatArray, time_s: FloatArray, angle_rad: FloatArray
) -> BoolArray:
    """At which of the even instants ``time_s`` (n,) the servo asks for so much torque that its limit may hold it, with
    the commands (m,) that were sent."""
    held = np.clip(np.searchsorted(sent_s, time_s, side="right") - 1, 0, None)
    step_s = (time_s[-1] - time_s[0]) / max(time_s.size - 1, 1)
    error = command[held] - fed_back_of(servo, angle_rad, step_s)
    return np.asarray(np.abs(error) > NEAR_LIMIT * servo.greatest_error)


def response(servo: Servo, bandwidth_rad_s: float, omega_rad_s: FloatArray) -> npt.NDArray[np.complex128]:
    """Behind the amplifier's lag, of a sine of the angle at these frequencies (n,)."""

    def turned(late_s: float) -> npt.NDArray[np.complex128]:
        return np.asarray(np.exp(-1j * omega_rad_s * late_s))

    ahead = servo.of_velocity / servo.window_s * (1.0 - turned(servo.window_s))
    return np.asarray(turned(servo.delay_s) * (servo.of_angle + ahead) / (1.0 + 1j * omega_rad_s / bandwidth_rad_s))


def position_errors(servo: Servo, bandwidth_rad_s: float, kernel: Kernel, tick_s: float) -> FloatArray:
    """What errors of the angle of density 1 [rad²/Hz, two-sided] add to the products of two of the regression's columns
    (5, 5), each through ``kernel``: those of gain, inertia and viscous damping have them."""
    frequency, power = kernel.spectrum()
    omega_rad_s = 2 * np.pi * frequency / tick_s
    errors = np.zeros((5, frequency.size), dtype=np.complex128)
    errors[GAIN] = -response(servo, bandwidth_rad_s, omega_rad_s)
    errors[INERTIA], errors[VISCOUS] = omega_rad_s**2, -1j * omega_rad_s
    weighted = errors * power * (frequency[1] - frequency[0]) / tick_s
    return np.asarray(2.0 * (weighted @ errors.conj().T).real)


@dataclass(frozen=True)
class SharedErrors:
    """What errors of the position readings add to the ``products`` (5, 5) of the regression's first columns, but for
    the squares that are counted by themselves.

    Of free motion the acceleration is no column but the target; its place in the products is that of the inertia.
    """

    products: FloatArray
    free_motion: bool

    @property
    def of_columns(self) -> FloatArray:
        """Those of two columns."""
        kept = self._columns()
        return np.asarray(self.products * np.outer(kept, kept))

    def pull(self, linear: FloatArray) -> FloatArray:
        """What they take off the products (5,) of columns and residual at these linear unknowns."""
        return np.asarray(self._columns() * (self.products @ self._carried(linear)))

    def square(self, linear: FloatArray) -> float:
        """What they add to the square of the residual."""
        carried = self._carried(linear)
        return float(carried @ self.products @ carried)

    def _columns(self) -> FloatArray:
        kept = np.ones(5)
        kept[INERTIA] = 0.0 if self.free_motion else 1.0
        return kept

    def _carried(self, linear: FloatArray) -> FloatArray:
        carried = np.array(linear[:5], dtype=np.float64)
        carried[INERTIA] = 1.0 if self.free_motion else carried[INERTIA]
        return carried


def lag_of_place(servo: Servo, bandwidth_rad_s: float, angle_rad: FloatArray, step_s: float) -> FloatArray:
    """Behind the amplifier's lag, of an angle (n,) every ``step_s``."""
    return fed_back_of(servo, loops.lag_of(angle_rad, bandwidth_rad_s * step_s), step_s)
