"""What a rig file may say of an ODrive on a serial line."""

from typing import ClassVar, Final

from pydantic import Field

from norton_drivers.codecs import odrive_ascii as ascii_protocol
from norton_drivers.codecs.odrive_ascii import line
from norton_drivers.odrive.axis import ODriveAxisOptions
from norton_drivers.serial_timing import Exchange

_THINKING_S = 0.2e-3  # bytes are looked for at 8 kHz (interface_uart.cpp)
# So many properties are read in that time.
ASIDES, ASIDE_PERIOD_S = 4, 0.1
_LONGEST_ASIDE = len(line("r axis0.motor.current_control.Iq_measured"))
_QUESTION_BYTES: Final = len(line("f 0"))


class ODriveUartOptions(ODriveAxisOptions):
    """What a rig file may say of an ODrive on a serial line."""

    asked: ClassVar[tuple[str, ...]] = ("baud",)

    axis: int = Field(0, ge=0, le=1, description="which motor of the board", examples=[0])
    baud: int = Field(
        115_200, ge=0, description="of its UART; 0 on its own USB port, which has none", examples=[921_600]
    )
    timeout_s: float = Field(0.02, alias="timeout", gt=0, le=1, description="how long to wait for an answer")

    @property
    def exchange(self) -> Exchange:
        longest = ascii_protocol.LONGEST_TORQUE, _QUESTION_BYTES, ascii_protocol.LONGEST_FEEDBACK
        return Exchange(self.baud, *longest, _THINKING_S, aside_bytes_s=ASIDES * _LONGEST_ASIDE / ASIDE_PERIOD_S)
