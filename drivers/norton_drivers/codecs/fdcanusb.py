"""The serial protocol of mjbots' CAN FD adapters (fdcanusb, mjcanfd-usb-1x) and of a moteus on its own UART.

A command is a line, answered with ``OK`` or ``ERR`` and why. ``can send ID DATA FLAGS`` sends a frame, ``can std`` and
``can ext`` one whose identifier is standard or extended whatever its size; ``rcv ID DATA FLAGS`` is a frame that came.
Identifier and data are hexadecimal. Flags: ``E`` extended, ``B`` data at the second bit rate, ``F`` CAN FD, ``R``
remote, small letters the contrary; ``t`` and ``f`` with digits are a time stamp and the filter that let it pass. A line
may end in `` *`` and two hexadecimal digits, a CRC-8 of all before the asterisk. Sources: mjbots/fdcanusb, README.md
and fw/can_manager.cc (``Command_Send``, which takes no frame without data; ``Poll``; ``Command_Status``);
mjbots/moteus, docs/integration/uart.md.
"""

import re
from typing import Final, Self

from norton_drivers.codecs.can_frames import CLASSICAL_LENGTH_MAX, STANDARD_MAX, LineFrame
from norton_drivers.codecs.common import CodecError, crc8_97
from norton_drivers.codecs.lines import LineStream

OK: Final = b"OK"
ERROR: Final = b"ERR"
BUS_ON: Final = b"can on"
BUS_OFF: Final = b"can off"
ASK_STATUS: Final = b"can status"
BITRATE, DATA_BITRATE, SEND_AGAIN = "can.bitrate", "can.fd_bitrate", "can.automatic_retransmission"

_LONGEST: Final = 256  # a frame of 64 bytes with every flag has some 170 characters
_DATA: Final = rb"(?:[0-9A-Fa-f]{2}){0,64}"
_COMMAND: Final = re.compile(rb"can (send|std|ext) +([0-9A-Fa-f]{1,8}) +(" + _DATA + rb")((?: *[BbFfRr])*)")
_EVENT: Final = re.compile(rb"rcv ([0-9A-Fa-f]{1,8}) (" + _DATA + rb")((?: +(?:[EeBbFfRr]|t\d+|f-?\d+))*)")
_SETTING: Final = re.compile(rb"conf set ([a-z_.]+) +(\S+)")
_STATUS: Final = re.compile(rb"(?:[a-z]+=\d+ ?)+")
_CHECKSUM: Final = re.compile(rb"(.*)\*([0-9A-Fa-f]{2})", re.DOTALL)

# The last error of a bus. Source: Bosch, M_CAN user's manual, register PSR, field LEC; 0 is none, 7 none since asked.
_LAST_ERRORS: Final = {
    1: "bit stuffing error",
    2: "form error",
    3: "no acknowledgement",
    4: "recessive bit error",
    5: "dominant bit error",
    6: "CRC error",
}


def line_stream() -> LineStream:
    """Cuts the bytes of either end into lines."""
    return LineStream(mid_line=False, longest=_LONGEST)


def setting(name: str, value: int) -> bytes:
    """The command that sets a value of the adapter's until it is switched off."""
    return f"conf set {name} {value}".encode()


def setting_in(line: bytes) -> tuple[str, str] | None:
    """Name and value in such a command; None for another line."""
    match = _SETTING.fullmatch(line)
    return None if match is None else (match[1].decode(), match[2].decode())


def with_checksum(line: bytes) -> bytes:
    """A line as a moteus wants it on its UART."""
    return b"%b *%02X" % (line, crc8_97(line + b" "))


def checked(line: bytes) -> bytes:
    """The line without its checksum, if it has one. Raises CodecError for a wrong one."""
    match = _CHECKSUM.fullmatch(line)
    if match is None:
        return line
    if crc8_97(match[1]) != int(match[2], 16):
        raise CodecError(f"wrong checksum: {line!r}")
    return match[1].rstrip(b" ")


def status_in(line: bytes) -> dict[str, int] | None:
    """The adapter's answer to :data:`ASK_STATUS`; None for another line."""
    if not _STATUS.fullmatch(line):
        return None
    return {name.decode(): int(value) for name, value in (word.split(b"=") for word in line.split())}


def encode_status(status: dict[str, int]) -> bytes:
    """The adapter's answer to :data:`ASK_STATUS`."""
    return " ".join(f"{name}={value}" for name, value in status.items()).encode()


def status_words(status: dict[str, int]) -> tuple[str, ...]:
    """What is wrong, in words."""
    last = {_LAST_ERRORS.get(status.get(name, 0), "") for name in ("lec", "dlec")}
    marks = {"err": "error-passive", "warn": "error warning level reached", "busoff": "bus-off"}
    return (*sorted(filter(None, last)), *(words for name, words in marks.items() if status.get(name)))


class FdcanusbFrame(LineFrame):
    """One CAN frame in a line."""

    __slots__ = ()

    def encode_command(self) -> bytes:
        """The host's command to send it. Raises CodecError for a frame that cannot be sent."""
        self.check()
        if not self.length:
            raise CodecError("the adapter sends no frame without data")
        data = bytes(self.length) if self.remote else self.data
        own = self.extended == (self.arbitration_id > STANDARD_MAX)
        verb = "send" if own else "ext" if self.extended else "std"
        flags = ("B" if self.switched else "b") + ("F" if self.fd else "f") + ("R" if self.remote else "")
        return f"can {verb} {self.arbitration_id:04X} {data.hex().upper()} {flags}".encode()

    def encode_event(self) -> bytes:
        """The adapter's word that it was received."""
        flags = " ".join(
            (
                "E" if self.extended else "e",
                "B" if self.switched else "b",
                "F" if self.fd else "f",
                "R" if self.remote else "r",
            )
        )
        data = bytes(self.length) if self.remote else self.data
        return f"rcv {self.arbitration_id:X} {data.hex().upper()} {flags} f-1".encode()

    @classmethod
    def decode_command(cls, line: bytes) -> Self:
        """A ``can`` command; what the flags leave open is CAN FD with two bit rates, as the adapter is delivered.
        Raises CodecError."""
        match = _COMMAND.fullmatch(line)
        if match is None or not match[3]:
            raise CodecError(f"no frame to send: {line!r}")
        flags, arbitration_id = match[4], int(match[2], 16)
        extended = match[1] == b"ext" or (match[1] == b"send" and arbitration_id > STANDARD_MAX)
        remote, fd = b"R" in flags, not (b"f" in flags or b"R" in flags)
        return cls._of(arbitration_id, match[3], extended, remote, fd, fd and b"b" not in flags)

    @classmethod
    def decode_event(cls, line: bytes) -> Self:
        """A ``rcv`` line. Raises CodecError."""
        match = _EVENT.fullmatch(line)
        if match is None:
            raise CodecError(f"no frame received: {line!r}")
        flags, arbitration_id = match[3].split(), int(match[1], 16)
        extended = b"E" in flags or (b"e" not in flags and arbitration_id > STANDARD_MAX)
        fd = b"F" in flags or (b"f" not in flags and len(match[2]) > 2 * CLASSICAL_LENGTH_MAX)
        return cls._of(arbitration_id, match[2], extended, b"R" in flags, fd, b"B" in flags)

    @classmethod
    def _of(cls, arbitration_id: int, digits: bytes, extended: bool, remote: bool, fd: bool, switched: bool) -> Self:
        data = bytes.fromhex(digits.decode())
        frame = cls(arbitration_id, b"" if remote else data, len(data), extended, remote, fd, fd and switched)
        frame.check()
        return frame
