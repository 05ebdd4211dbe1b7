"""The options that all servos on a half-duplex line have."""

from pydantic import Field

from norton_drivers.wiring import DeviceOptions


class BusServoOptions(DeviceOptions):
    """Base of their drivers' options. ``watchdog_s`` is 0 where a family has no watchdog."""

    node: int = Field(ge=0, le=252, description="the servo's id", examples=[1])
    baud: int = Field(1_000_000, gt=0, description="the baud rate set in the servos on this line", examples=[1_000_000])
    return_delay_s: float = Field(
        0.0,
        alias="return_delay",
        ge=0,
        le=508e-6,
        description="how long the servo waits before it answers, as set in it",
        examples=["0 us"],
    )
    latency_s: float = Field(
        1e-3,
        alias="latency",
        ge=0,
        le=0.05,
        description="how long the adapter takes to carry a question there and an answer back",
        examples=["1 ms"],
    )

    @property
    def watchdog_s(self) -> float:
        return 0.0
