"""What a rig file may say of a SimpleFOC board."""

from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.codecs import simplefoc as protocol
from norton_drivers.drive_base import FedWatchdog
from norton_drivers.serial_timing import Exchange
from norton_drivers.wiring import DeviceOptions

# A sketch looks for lines once in its loop, and prints some seventy characters.
THINKING_S = 0.3e-3


class SimpleFocOptions(DeviceOptions):
    """Of one motor."""

    asked: ClassVar[tuple[str, ...]] = ("mode", "baud")
    command_units: ClassVar = {"A": {"mode": "current"}, "N*m": {"mode": "torque"}, "1": {"mode": "voltage"}}

    letter: str = Field("M", pattern="^[A-Za-z]$", description="the motor's, as the sketch gave it to Commander.add")
    mode: Literal["current", "torque", "voltage"] = Field(
        "current", description='what is commanded: "current" [A], "torque" [N*m] or "voltage" (share of the supply)'
    )
    current_limit_a: float | None = Field(
        None,
        alias="current_limit",
        gt=0,
        validate_default=True,
        description='the board\'s own, which the bench sets; needed but with mode = "voltage"',
        examples=["9 A"],
    )
    torque_constant_nm_a: float | None = Field(
        None,
        alias="torque_constant",
        gt=0,
        validate_default=True,
        description='the motor\'s, with mode = "torque": the current for a torque is worked out with it',
        examples=["0.05 N*m/A"],
    )
    supply_v: float | None = Field(
        None,
        alias="supply",
        gt=0,
        validate_default=True,
        description='of the driver, with mode = "voltage": a command of 1',
        examples=["12 V"],
    )
    sensing: Literal["foc", "dc"] = Field("foc", description='how currents are controlled: "foc" (d and q) or "dc"')
    decimals: int = Field(5, ge=3, le=6, description="of all numbers on the line: fewer make it quicker and coarser")
    baud: int = Field(115_200, ge=0, description="as in the sketch; 0 on the board's own USB port", examples=[921_600])
    timeout_s: float = Field(0.02, alias="timeout", gt=0, le=1, description="how long to wait for an answer")
    watchdog_s: FedWatchdog = Field(
        0.0,
        alias="watchdog",
        ge=0,
        le=10,
        description="the timeout that the sketch itself has; 0 for none, for the library has none",
        examples=["200 ms"],
    )

    @field_validator("current_limit_a", "torque_constant_nm_a", "supply_v")
    @classmethod
    def _is_there(cls, value: float | None, info: ValidationInfo) -> float | None:
        mode = info.data.get("mode")
        needs = {
            "current_limit_a": mode in ("current", "torque"),
            "torque_constant_nm_a": mode == "torque",
            "supply_v": mode == "voltage",
        }
        if value is None and needs[info.field_name or ""]:
            raise ValueError(f'mode = "{mode}" needs it')
        return value

    @property
    def per_target(self) -> float:
        """The command that a target of 1 A or 1 V is."""
        if self.mode == "torque":
            return self.torque_constant_nm_a or 1.0
        return 1 / (self.supply_v or 1.0) if self.mode == "voltage" else 1.0

    @property
    def controller(self) -> str:
        """A key of :data:`norton_drivers.codecs.simplefoc.CONTROLLERS`."""
        return "voltage" if self.mode == "voltage" else self.sensing

    @property
    def exchange(self) -> Exchange:
        target = 4 + self.decimals + 1
        longest = protocol.longest_state(self.decimals)
        return Exchange(self.baud, target + 2, len(b"MMG7\n"), longest, THINKING_S, echo_bytes=target + 2)
