"""An slcan adapter's word on how it is, over a pseudo-terminal whose far end stands in for the adapter."""

import os
import pty
import time
import tty
from collections import deque
from collections.abc import Iterator

import pytest

from norton_drivers.errors import ConnectionFailedError
from norton_drivers.hardware import HardwareBackend
from norton_drivers.ports import CanPort
from norton_drivers.wiring import CanBusSettings

pytestmark = pytest.mark.wall_time


class FarEnd:
    """What the adapter hears and says."""

    def __init__(self) -> None:
        self.fd, far = pty.openpty()
        tty.setraw(self.fd)
        os.set_blocking(self.fd, False)
        self.path = os.ttyname(far)

    def heard(self) -> bytes:
        time.sleep(0.01)
        try:
            return os.read(self.fd, 65536)
        except BlockingIOError:
            return b""

    def say(self, data: bytes) -> None:
        os.write(self.fd, data)
        time.sleep(0.01)


@pytest.fixture
def emulated() -> Iterator[FarEnd]:
    made = FarEnd()
    yield made
    os.close(made.fd)


@pytest.fixture
def port(emulated: FarEnd) -> Iterator[CanPort]:
    backend = HardwareBackend()
    opened = backend.open_can(CanBusSettings("can0", "slcan", emulated.path, 500_000))
    emulated.heard()
    yield opened
    backend.close()


def test_the_adapter_is_opened_at_the_rigs_bitrate(emulated):
    backend = HardwareBackend()
    backend.open_can(CanBusSettings("can0", "slcan", emulated.path, 250_000))
    assert b"C\rS5\r" in emulated.heard()
    backend.close()


def test_flags_are_counted_as_they_rise(emulated, port):
    for answer in (b"F00\r", b"F08\r", b"F08\r", b"F00\r", b"F88\r"):
        port.ask()
        assert emulated.heard() == b"F\r"
        emulated.say(answer)
        port.poll()
    assert port.troubles() == {"receive overrun": 2, "bus error": 1}


def test_bus_off_is_a_lost_bus(emulated, port):
    port.ask()
    emulated.say(b"F10\r")
    port.poll()
    with pytest.raises(ConnectionFailedError, match=r"has left the bus .*its status flags say bus-off"):
        port.ask()


@pytest.mark.parametrize("answer", [b"", b"\a"])
def test_an_adapter_that_knows_no_flags_is_left_alone(emulated, port, answer):
    questions = b""
    for _ in range(6):
        port.ask()
        heard = emulated.heard()
        questions += heard
        if heard:
            emulated.say(answer)
        port.poll()
    assert questions == b"F\r" * 3
    assert port.troubles() == {}


def test_refused_commands_are_counted(emulated, port):
    emulated.say(b"\a\a")
    port.poll()
    assert port.troubles() == {"commands refused by the adapter": 2}


def test_an_adapter_that_takes_nothing_more_does_not_hold_up_the_loop(emulated, port):
    took_s = []

    def send() -> None:
        began_s = time.monotonic()
        try:
            port.send(0x123, bytes(8))
        finally:
            took_s.append(time.monotonic() - began_s)

    with pytest.raises(ConnectionFailedError, match="bus can0: cannot send"):
        deque((send() for _ in range(2000)), maxlen=0)  # more than a pseudo-terminal holds
    assert max(took_s) < 1.0


def test_two_programs_on_one_adapter_are_refused(emulated, port):
    with pytest.raises(ConnectionFailedError, match="another program has it open"):
        HardwareBackend().open_can(CanBusSettings("can1", "slcan", emulated.path, 500_000))
