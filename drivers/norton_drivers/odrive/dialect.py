"""What one firmware of an ODrive says otherwise than another, and what of the drive it needs to say it."""

from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol

from norton_drivers.codecs.odrive import Temperature
from norton_drivers.errors import DeviceTimeoutError

Handler = Callable[[bytearray, int], None]  # payload, arrival


class Message(Protocol):
    """Anything of the codecs that can be sent."""

    @property
    def COMMAND(self) -> int: ...  # noqa: N802  (a constant of the class)
    def encode(self) -> bytes: ...


class Heard(NamedTuple):
    """What a heartbeat says, whatever the firmware: ``failed`` where something must be mended or cleared."""

    error_bits: int
    axis_state: int
    failed: bool


class DriveOptions(Protocol):
    """The part of the options that is needed here."""

    @property
    def watchdog_s(self) -> float: ...
    @property
    def watchdog_timeout_endpoint(self) -> int: ...
    @property
    def enable_watchdog_endpoint(self) -> int: ...


class Drive(Protocol):
    """The part of the driver that is needed here."""

    @property
    def options(self) -> DriveOptions: ...
    @property
    def place(self) -> str: ...
    def send(self, message: Message) -> None: ...
    def request(self, command: int) -> None: ...
    def command(self, value: float) -> float: ...
    def arrives(self, arrived: Callable[[], bool], timeout_s: float) -> bool: ...
    def wait_for(self, arrived: Callable[[], bool], timeout_s: float, otherwise: str) -> None: ...
    def late(self, timeout_s: float, otherwise: str) -> DeviceTimeoutError: ...


class Dialect(Protocol):
    """One firmware's own messages."""

    @property
    def clear_errors(self) -> Message: ...

    @property
    def encoder_rate(self) -> str:
        """The name of the drive's own setting for how often it sends its estimates."""
        ...

    @property
    def temperature(self) -> Temperature:
        """As last told; NaN where this firmware tells none."""
        ...

    def handlers(self) -> Mapping[int, Handler]:
        """What is to be called for messages that only this firmware sends, by command."""
        ...

    def heard(self, data: bytearray) -> Heard:
        """Read a heartbeat. Raises CodecError."""
        ...

    def identify(self, timeout_s: float) -> tuple[str, str]:
        """Hardware and firmware, as the drive tells. Raises DeviceTimeoutError; DeviceError for another firmware."""
        ...

    def arm_watchdog(self) -> None:
        """See that the drive's watchdog is armed, as far as this firmware lets anybody. Raises DeviceError."""
        ...

    def ask_why(self) -> None:
        """Ask for the reasons of a failure. Raises ConnectionFailedError."""
        ...

    def forget(self) -> None:
        """Errors were cleared: past reasons are none any more."""
        ...

    def errors(self, error_bits: int) -> tuple[str, ...]:
        """A heartbeat's errors and all that has been told since, in words."""
        ...

    def refusals(self) -> tuple[str, ...]:
        """Why the loop was not closed, where the drive tells it otherwise than by errors."""
        ...
