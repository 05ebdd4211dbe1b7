"""What a rig file says of an ODrive's axis, whichever line it is on."""

from typing import ClassVar

from pydantic import Field, field_validator

from norton_drivers.drive_base import FedWatchdog
from norton_drivers.wiring import DeviceOptions

SPOKEN = ("0.5", "0.6")


class ODriveAxisOptions(DeviceOptions):
    """Firmware, watchdog and encoder."""

    command_units: ClassVar = {"N*m": {}}

    firmware: str = Field("0.6", description="the firmware's version, 0.5 or 0.6", examples=["0.6"])
    watchdog_s: FedWatchdog = Field(
        0.1,
        alias="watchdog",
        ge=0,
        le=10,
        description="silence that makes the drive stop, with firmware 0.5 on CAN as it is set in the drive; "
        '"0 s" leaves the drive\'s watchdog as it is',
        examples=["100 ms"],
    )
    counts_per_turn: int = Field(0, ge=0, description="encoder counts per turn; 0 where unknown", examples=[16384])

    @field_validator("firmware")
    @classmethod
    def _is_supported(cls, firmware: str) -> str:
        if firmware not in SPOKEN:
            raise ValueError('firmware "0.5" and "0.6" are spoken here; update the drive')
        return firmware
