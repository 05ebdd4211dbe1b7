"""A serial line over TCP: what is written arrives, one program at a time has it, and it may be hung up."""

import socket
import time
from collections.abc import Iterator

import pytest

from norton_drivers.errors import ConnectionFailedError
from norton_drivers.hardware import HardwareBackend
from norton_drivers.ports import SerialPort
from norton_sim.served_ports import ServedSocket


def free_port() -> int:
    with socket.create_server(("localhost", 0)) as probe:
        return int(probe.getsockname()[1])


@pytest.fixture
def url() -> str:
    return f"socket://localhost:{free_port()}"


@pytest.fixture
def served(url: str) -> Iterator[ServedSocket]:
    served = ServedSocket(url)
    yield served
    served.hang_up()


def test_both_ways_through_the_hardware_backend(served: ServedSocket, url: str) -> None:
    served.write(b"nobody hears")
    backend, heard = HardwareBackend(), list[bytes]()
    port = backend.open_serial(url, 460_800)
    port.subscribe(lambda data, _arrival_ns: heard.append(data))
    port.send(b"question")
    assert soon_read(served) == b"question"
    served.write(b"an answer of 40 bytes, all in one piece.")
    end_s = time.monotonic() + 5.0
    while not heard and time.monotonic() < end_s:
        port.poll()
    assert heard == [b"an answer of 40 bytes, all in one piece."]
    served.hang_up()
    with pytest.raises(ConnectionFailedError, match="lost"):
        poll_for_long(port)
    backend.close()


def test_who_opens_it_again_gets_it_again(served: ServedSocket, url: str) -> None:
    for words in (b"first", b"second"):
        backend = HardwareBackend()
        backend.open_serial(url, 9600).send(words)
        assert soon_read(served) == words
        backend.close()


def test_an_address_that_somebody_has_is_said_so(served: ServedSocket, url: str) -> None:
    with pytest.raises(ConnectionFailedError, match="cannot serve it"):
        ServedSocket(url)


def poll_for_long(port: SerialPort) -> None:
    for _ in range(1000):
        port.poll()
        time.sleep(0.001)


def soon_read(served: ServedSocket) -> bytes:
    end_s, data = time.monotonic() + 5.0, b""
    while not data and time.monotonic() < end_s:
        data = served.read()
    return data
