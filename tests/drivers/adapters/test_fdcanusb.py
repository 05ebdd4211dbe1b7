"""An fdcanusb over a pseudo-terminal: our emulated adapter, and a far end that says what a test wants."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest

from norton_drivers.errors import ConnectionFailedError
from norton_drivers.hardware import HardwareBackend
from norton_drivers.ports import CanPort
from norton_drivers.wiring import CanBusSettings
from norton_sim.connectors import CAN_ERR_PROTOCOL, Trouble
from norton_sim.served_adapters import ServedFdcanusb

pytestmark = pytest.mark.wall_time


class Adapter:
    """An emulated adapter with a thread of its own, as it would have a processor of its own."""

    def __init__(self, settings: CanBusSettings) -> None:
        self.served = ServedFdcanusb(settings, lambda: None)
        self.heard: list[can.Message] = []
        self.served.attach(self)  # type: ignore[arg-type]
        self._trouble: Trouble | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def deliver(self, message: can.Message) -> None:
        self.heard.append(message)
        self.served.to_host(0x100, bytes(message.data)[::-1], False, message.is_fd)

    def suffer(self, trouble: Trouble) -> None:
        """Done by the thread that reads the port: nobody else closes it meanwhile."""
        self._trouble = trouble

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self.served.close()

    def _run(self) -> None:
        while not self._over.wait(0.5e-3):
            if self._trouble is not None:
                self.served.suffer(self._trouble)
            elif not self.served.lost:
                self.served.receive()


def settings_at(path: Path, **options: object) -> CanBusSettings:
    return CanBusSettings("can0", "fdcanusb", str(path), 1_000_000, options, fd=True, data_bitrate_bit_s=5_000_000)


@contextmanager
def opened(settings: CanBusSettings) -> Iterator[tuple[Adapter, CanPort]]:
    adapter, backend = Adapter(settings), HardwareBackend()
    try:
        yield adapter, backend.open_can(settings)
    finally:
        backend.close()
        adapter.close()


def until(happened: Callable[[], bool], port: CanPort) -> bool:
    for _ in range(2000):
        if happened():
            return True
        port.poll()
        threading.Event().wait(0.5e-3)
    return False


@pytest.mark.parametrize("uart", [False, True])
def test_frames_pass_both_ways(tmp_path, uart):
    with opened(settings_at(tmp_path / "a", **({"uart": True} if uart else {}))) as (adapter, port):
        heard: list[can.Message] = []
        port.subscribe(lambda message, _: heard.append(message))
        port.send(0x8001, bytes(range(12)), extended=True, fd=True)
        port.send(0x21, b"\1\2")
        assert until(lambda: len(heard) == 2, port)
        assert [
            (each.arbitration_id, each.is_extended_id, each.is_fd, each.bitrate_switch) for each in adapter.heard
        ] == [
            (0x8001, True, True, True),
            (0x21, False, False, False),
        ]
        assert bytes(heard[0].data) == bytes(reversed(range(12)))
        assert (heard[0].is_fd, heard[0].bitrate_switch, heard[1].is_fd) == (True, True, False)
        assert not any(port.troubles().values())


def test_errors_on_the_bus_are_asked_for(tmp_path):
    with opened(settings_at(tmp_path / "a")) as (adapter, port):
        adapter.served.report_error(CAN_ERR_PROTOCOL)
        port.ask()
        assert until(lambda: port.troubles().get("form error") == 1, port)
        adapter.served.suffer(Trouble.BUS_OFF)
        port.ask()
        assert until(lambda: "bus-off" in port.troubles(), port)
        with pytest.raises(ConnectionFailedError, match=r"has left the bus .*its status says bus-off"):
            port.ask()


def test_an_adapter_that_is_pulled_out_is_a_lost_bus(tmp_path):
    with opened(settings_at(tmp_path / "a")) as (adapter, port):
        adapter.suffer(Trouble.UNPLUGGED)
        with pytest.raises(ConnectionFailedError, match="bus can0: lost"):
            until(lambda: False, port)


def test_a_frame_that_it_cannot_send_is_told(tmp_path):
    with opened(settings_at(tmp_path / "a")) as (_, port), pytest.raises(ConnectionFailedError, match="without data"):
        port.send(0x80, b"")


@contextmanager
def far_end(answers: Callable[[bytes], bytes]) -> Iterator[str]:
    """A pseudo-terminal whose far end answers each line."""
    near, far = os.openpty()
    os.set_blocking(near, False)
    over = threading.Event()

    def run() -> None:
        rest = b""
        while not over.wait(1e-3):
            try:
                *lines, rest = (rest + os.read(near, 4096)).split(b"\n")
            except BlockingIOError:
                continue
            os.write(near, b"".join(answers(line) for line in lines))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield os.ttyname(far)
    finally:
        over.set()
        thread.join()
        os.close(near)
        os.close(far)


@pytest.mark.parametrize(
    ("answers", "words"),
    [
        (lambda _line: b"", "no answer to 'can off': it is no fdcanusb"),
        (lambda line: b"ERR bad value\r\n" if b"fd_bitrate" in line else b"OK\r\n", "refuses 'conf set can.fd_bitrate"),
    ],
    ids=["silent", "refuses"],
)
def test_what_is_no_such_adapter_is_refused(answers, words):
    with far_end(answers) as path, pytest.raises(ConnectionFailedError, match=words):
        HardwareBackend().open_can(settings_at(Path(path)))


def test_garbage_is_counted_and_costs_nothing_else(tmp_path):
    def answers(line: bytes) -> bytes:
        return b"OK\r\n" if line.startswith((b"can o", b"conf")) else b"\xff\x00junk\r\nrcv 12 0G\r\nOK\n"

    with far_end(answers) as path:
        backend = HardwareBackend()
        port = backend.open_can(settings_at(Path(path)))
        port.send(0x8001, bytes(12), extended=True, fd=True)
        assert until(lambda: port.troubles() == {"malformed lines": 2}, port)
        backend.close()
