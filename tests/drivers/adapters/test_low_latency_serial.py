"""Serial ports read at once: the same bytes as pyserial gives, and a lost port is noticed."""

import os
import pty
import socket
import time
import tty
from collections.abc import Iterator

import pytest
import serial

from norton_drivers.adapters.serial_line import EagerSocket, LowLatencySerial


@pytest.fixture
def ends() -> Iterator[tuple[int, LowLatencySerial]]:
    """The far end's descriptor, and the port."""
    far, near = pty.openpty()
    tty.setraw(near)
    line = LowLatencySerial(serial.Serial(os.ttyname(near), 115_200, timeout=0))
    os.close(near)
    yield far, line
    line.close()


def counted(line: LowLatencySerial, size: int) -> bool:
    """Whether so many bytes are there, once the system has handed them over."""
    end_s = time.monotonic() + 5.0
    while line.in_waiting != size and time.monotonic() < end_s:
        time.sleep(0.001)
    return line.in_waiting == size


def test_it_reads_what_is_there_and_never_waits(ends: tuple[int, LowLatencySerial]) -> None:
    far, line = ends
    assert line.in_waiting == 0
    assert line.read(10) == b""
    os.write(far, b"abcdef")
    assert counted(line, 6)
    os.write(far, b"gh")
    assert counted(line, 8)
    assert line.read(4) == b"abcd"
    assert line.in_waiting == 4
    assert line.read(100) == b"efgh"
    assert line.in_waiting == 0
    os.close(far)


def test_it_writes(ends: tuple[int, LowLatencySerial]) -> None:
    far, line = ends
    assert line.write(b"xyz") == 3
    assert os.read(far, 10) == b"xyz"
    os.close(far)


def test_a_port_whose_far_end_is_gone_is_lost(ends: tuple[int, LowLatencySerial]) -> None:
    far, line = ends
    os.close(far)
    with pytest.raises(OSError, match="Input/output error"):
        _ = line.in_waiting


@pytest.fixture
def far_and_near() -> Iterator[tuple[socket.socket, EagerSocket]]:
    """A serial line behind TCP."""
    with socket.create_server(("localhost", 0)) as listener:
        line = EagerSocket(serial.serial_for_url(f"socket://localhost:{listener.getsockname()[1]}", timeout=0))
        far, _ = listener.accept()
    with far:
        yield far, line
        line.close()


def test_a_line_behind_tcp_is_read_in_whole_chunks(far_and_near: tuple[socket.socket, EagerSocket]) -> None:
    far, line = far_and_near
    assert line.in_waiting == 0
    far.sendall(b"abcdefgh")
    assert counted(line, 8)
    assert line.read(100) == b"abcdefgh"
    assert line.write(b"xyz") == 3
    assert far.recv(10) == b"xyz"


def test_a_line_behind_tcp_that_was_closed_is_lost(far_and_near: tuple[socket.socket, EagerSocket]) -> None:
    far, line = far_and_near
    far.sendall(b"last")
    far.close()
    assert counted(line, 4)
    assert line.read(4) == b"last"
    with pytest.raises(OSError, match="closed"):
        counted(line, 1)
