"""What a rig file may say of a VESC on a serial line."""

from typing import ClassVar, Final

from pydantic import Field

from norton_drivers.codecs import vesc_uart
from norton_drivers.codecs.vesc import NODE_MAX
from norton_drivers.codecs.vesc_uart import Value, mask_of
from norton_drivers.serial_timing import Exchange
from norton_drivers.vesc.motor import VescMotorOptions

SLOW: Final = (Value.TRANSISTOR_C, Value.MOTOR_C, Value.SUPPLY_V)
_FORWARD_BYTES = 2
_COMMAND_BYTES = _QUESTION_BYTES = 10
# Bytes wait for a thread of the firmware's, of low priority (app_uartcomm.c); beyond, a CAN bus must be passed twice.
_THINKING_S, _FORWARDING_S = 0.15e-3, 0.7e-3


class VescUartOptions(VescMotorOptions):
    """What a rig file may say of a VESC on a serial line."""

    asked: ClassVar[tuple[str, ...]] = (*VescMotorOptions.asked, "baud")

    baud: int = Field(
        115_200, ge=0, description="of its UART; 0 on its own USB port, which has none", examples=[921_600]
    )
    forward: int | None = Field(
        None, ge=0, le=NODE_MAX, description="the VESC ID of another that is meant, on the CAN bus of this one"
    )
    timeout_s: float = Field(0.02, alias="timeout", gt=0, le=1, description="how long to wait for an answer")

    @property
    def fast_mask(self) -> int:
        """What every question asks for."""
        place = Value.POSITION_DEG if self.position == "encoder" else Value.TACHOMETER
        return mask_of(Value.Q_A, Value.ERPM, Value.FAULT, place, Value.STATUS)

    @property
    def exchange(self) -> Exchange:
        more = 0 if self.forward is None else _FORWARD_BYTES
        longest = vesc_uart.answer_length(self.fast_mask | mask_of(*SLOW))
        thinking_s = _THINKING_S + (0.0 if self.forward is None else _FORWARDING_S)
        return Exchange(self.baud, _COMMAND_BYTES + more, _QUESTION_BYTES + more, longest, thinking_s)
