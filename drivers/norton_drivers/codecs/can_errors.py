"""CAN error frames as Linux lays them out, and what they mean in words.

The identifier says the classes of error, the data their details. socketcan and gs_usb hand them on as they are,
socketcand without the details. Source: Linux, include/uapi/linux/can/error.h.
"""

from dataclasses import dataclass
from enum import IntFlag
from typing import Final

LENGTH: Final = 8


class ErrorClass(IntFlag):
    """Bits of the identifier."""

    TX_TIMEOUT = 0x001
    LOST_ARBITRATION = 0x002
    CONTROLLER = 0x004
    PROTOCOL = 0x008
    TRANSCEIVER = 0x010
    NO_ACKNOWLEDGEMENT = 0x020
    BUS_OFF = 0x040
    BUS_ERROR = 0x080
    RESTARTED = 0x100
    COUNTERS = 0x200


class ControllerError(IntFlag):
    """Bits of data byte 1."""

    RX_OVERFLOW = 0x01
    TX_OVERFLOW = 0x02
    RX_WARNING = 0x04
    TX_WARNING = 0x08
    RX_PASSIVE = 0x10
    TX_PASSIVE = 0x20
    ACTIVE = 0x40


class ProtocolError(IntFlag):
    """Bits of data byte 2."""

    BIT = 0x01
    FORM = 0x02
    STUFF = 0x04
    BIT_0 = 0x08
    BIT_1 = 0x10
    OVERLOAD = 0x20
    ACTIVE = 0x40
    TX = 0x80


_NO_CONTROLLER_ERROR: Final = ControllerError(0)
_NO_PROTOCOL_ERROR: Final = ProtocolError(0)
_CLASS_WORDS: Final = (
    (ErrorClass.TX_TIMEOUT, "a frame could not be sent in time"),
    (ErrorClass.LOST_ARBITRATION, "arbitration lost"),
    (ErrorClass.NO_ACKNOWLEDGEMENT, "no acknowledgement"),
    (ErrorClass.BUS_OFF, "bus-off"),
    (ErrorClass.RESTARTED, "controller restarted"),
)
_CONTROLLER_WORDS: Final = (
    (ControllerError.RX_OVERFLOW, "receive overrun"),
    (ControllerError.TX_OVERFLOW, "send buffer overflow"),
    (ControllerError.RX_WARNING | ControllerError.TX_WARNING, "error warning level reached"),
    (ControllerError.RX_PASSIVE | ControllerError.TX_PASSIVE, "error-passive"),
)
_PROTOCOL_WORDS: Final = (
    (ProtocolError.BIT | ProtocolError.BIT_0 | ProtocolError.BIT_1, "bit error"),
    (ProtocolError.FORM, "frame format error"),
    (ProtocolError.STUFF, "bit stuffing error"),
    (ProtocolError.OVERLOAD, "bus overload"),
)


@dataclass(frozen=True, slots=True)
class CanErrorFrame:
    """One error frame. The error counters are the controller's, where it tells them (else 0)."""

    classes: ErrorClass
    controller: ControllerError = _NO_CONTROLLER_ERROR
    protocol: ProtocolError = _NO_PROTOCOL_ERROR
    transceiver: int = 0
    tx_errors: int = 0
    rx_errors: int = 0

    def encode(self) -> tuple[int, bytes]:
        """Identifier and data."""
        data = (0, self.controller, self.protocol, 0, self.transceiver, 0, self.tx_errors, self.rx_errors)
        return int(self.classes), bytes(data)

    @classmethod
    def decode(cls, arbitration_id: int, data: bytes | bytearray) -> "CanErrorFrame":
        """Never raises: what is missing of the data is zero, what is unknown is left out."""
        details = bytes(data[:LENGTH]).ljust(LENGTH, b"\0")
        return cls(
            ErrorClass(arbitration_id & 0x3FF),
            ControllerError(details[1] & 0x7F),
            ProtocolError(details[2]),
            details[4],
            details[6],
            details[7],
        )

    @property
    def bus_off(self) -> bool:
        """The controller has taken itself off the bus."""
        return ErrorClass.BUS_OFF in self.classes

    @property
    def restarted(self) -> bool:
        """The controller takes part again."""
        return ErrorClass.RESTARTED in self.classes

    def words(self) -> tuple[str, ...]:
        """What happened; never empty."""
        message = [text for bit, text in _CLASS_WORDS if self.classes & bit]
        if ErrorClass.CONTROLLER in self.classes:
            message += [text for bits, text in _CONTROLLER_WORDS if self.controller & bits]
        if ErrorClass.PROTOCOL in self.classes:
            message += [text for bits, text in _PROTOCOL_WORDS if self.protocol & bits]
        if ErrorClass.TRANSCEIVER in self.classes:
            message.append("transceiver fault")
        return tuple(message) or ("bus error",)
