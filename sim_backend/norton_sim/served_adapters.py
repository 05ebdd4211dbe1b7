"""Emulated CAN adapters on serial lines, which other processes open as they would open real ones."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping

from norton_drivers.adapters.mended_buses import message_of
from norton_drivers.codecs import fdcanusb
from norton_drivers.codecs.can_frames import LineFrame
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.fdcanusb import FdcanusbFrame
from norton_drivers.codecs.slcan import FLAG_BUS_ERROR, FLAG_BUS_OFF, SlcanFrame, SlcanStream, encode_flags
from norton_drivers.wiring import CanBusSettings
from norton_sim.connectors import CAN_ERR_BUS_OFF, CanConnector, Trouble
from norton_sim.served_ports import served_port

CatchUp = Callable[[], None]


class ServedAdapter(ABC):
    """An adapter at the bus's ``channel``; ``catch_up`` brings the world to the present."""

    def __init__(self, settings: CanBusSettings, catch_up: CatchUp) -> None:
        self._port = served_port(settings.channel.partition("@")[0])
        self._catch_up = catch_up
        self._switches_bitrate = settings.switches_bitrate
        self._plugs: list[CanConnector] = []
        self._off_bus = False

    @property
    def lost(self) -> bool:
        return self._port.hung_up

    def suffer(self, trouble: Trouble | None) -> None:
        if trouble is Trouble.UNPLUGGED:
            self._port.hang_up()
        self._off_bus = trouble is Trouble.BUS_OFF

    def attach(self, plug: CanConnector) -> None:
        self._plugs.append(plug)

    def fileno(self) -> int:
        return self._port.fileno()

    def to_host(self, arbitration_id: int, data: bytes, extended: bool, fd: bool) -> None:
        if not self._off_bus:
            switched = fd and self._switches_bitrate
            self._port.write(self._received(arbitration_id, data, len(data), extended, False, fd, switched))

    def receive(self) -> None:
        data = self._port.read()
        self._catch_up()  # the line says nothing of when its bytes came
        for frame in self._sent(data):
            message = message_of(frame)
            for plug in () if self._off_bus else self._plugs:
                plug.deliver(message)

    def close(self) -> None:
        self._port.close()

    @abstractmethod
    def report_error(self, error_class: int) -> None:
        """Remember an error on the bus until the host asks."""

    @abstractmethod
    def _received(
        self, arbitration_id: int, data: bytes, length: int, extended: bool, remote: bool, fd: bool, switched: bool
    ) -> bytes:
        """The line for a frame that came from the bus."""

    @abstractmethod
    def _sent(self, data: bytes) -> Iterator[LineFrame]:
        """The frames that the host sends with ``data``; what else it says is answered."""


class ServedSlcan(ServedAdapter):
    """An slcan adapter; like many, it is always open, and answers but one command: ``F``."""

    def __init__(self, settings: CanBusSettings, catch_up: CatchUp) -> None:
        super().__init__(settings, catch_up)
        self._stream = SlcanStream()
        self._flags = 0

    def report_error(self, error_class: int) -> None:
        """The protocol has no error frames: the adapter says so in its status flags, when it is asked."""
        self._flags |= FLAG_BUS_OFF if error_class & CAN_ERR_BUS_OFF else FLAG_BUS_ERROR

    def _received(
        self, arbitration_id: int, data: bytes, length: int, extended: bool, remote: bool, fd: bool, switched: bool
    ) -> bytes:
        return SlcanFrame(arbitration_id, data, length, extended, remote, fd, switched).encode()

    def _sent(self, data: bytes) -> Iterator[LineFrame]:
        self._stream.feed(data)
        if self._stream.flags_asked:
            self._stream.flags_asked = 0
            self._port.write(encode_flags(self._flags))
            self._flags = 0
        while self._stream.frames:
            yield self._stream.frames.popleft()


class ServedFdcanusb(ServedAdapter):
    """An fdcanusb, on the bus as soon as it has power; or a moteus' own UART, which knows no settings, sends checksums,
    and wants them once it was sent one. Sources: mjbots/fdcanusb, fw/can_manager.cc; mjbots/moteus,
    docs/integration/uart.md."""

    def __init__(self, settings: CanBusSettings, catch_up: CatchUp) -> None:
        super().__init__(settings, catch_up)
        self._lines = fdcanusb.line_stream()
        self._uart = bool(settings.options.get("uart"))
        self._wants_checksums = False
        self._on = True
        self._last_error = 0

    def report_error(self, error_class: int) -> None:
        self._last_error = 0 if error_class & CAN_ERR_BUS_OFF else _FORM_ERROR

    def _received(
        self, arbitration_id: int, data: bytes, length: int, extended: bool, remote: bool, fd: bool, switched: bool
    ) -> bytes:
        frame = FdcanusbFrame(arbitration_id, data, length, extended, remote, fd, switched)
        return self._ended(frame.encode_event()) if self._on else b""

    def _ended(self, line: bytes) -> bytes:
        return (fdcanusb.with_checksum(line) if self._uart else line) + b"\r\n"

    def _sent(self, data: bytes) -> Iterator[LineFrame]:
        for line in self._lines.feed(data):
            try:
                text = fdcanusb.checked(line.text)
                self._wants_checksums |= self._uart and text != line.text
                frame = None if text.startswith(_OTHERS) else FdcanusbFrame.decode_command(text)
            except CodecError as error:
                self._answer(b"ERR " + str(error).encode())
                continue
            if self._wants_checksums and text == line.text:
                self._answer(b"ERR checksum missing")
            elif frame is None:
                self._answer(self._done(text))
            elif not self._on:
                self._answer(b"ERR not in BusOn state")
            else:
                self._answer(fdcanusb.OK)
                yield frame

    def _answer(self, line: bytes) -> None:
        self._port.write(self._ended(line))

    def _done(self, text: bytes) -> bytes:
        """The answer to what is no frame."""
        on = {fdcanusb.BUS_ON: True, fdcanusb.BUS_OFF: False}.get(text)
        if text == fdcanusb.ASK_STATUS:
            status = {"lec": self._last_error, "dlec": 0, "err": 0, "warn": 0, "busoff": int(self._off_bus)}
            self._last_error = 0
            return fdcanusb.encode_status({**status, "pexc": 0, "tdc": 0})
        if on is not None:
            was, self._on = self._on, on
            return fdcanusb.OK if was != on else b"ERR already in BusOn" if on else b"ERR already in BusOff"
        known = fdcanusb.setting_in(text) is not None and not self._uart
        return fdcanusb.OK if known else b"ERR unknown command"


_FORM_ERROR = 2
_OTHERS = (fdcanusb.BUS_ON, fdcanusb.BUS_OFF, fdcanusb.ASK_STATUS, b"conf")

# By the rig file's interface.
ADAPTERS: Mapping[str, Callable[[CanBusSettings, CatchUp], ServedAdapter]] = {
    "slcan": ServedSlcan,
    "fdcanusb": ServedFdcanusb,
}
