"""socketcand's client against a small server, spoken to over TCP as the real one is."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

import can
import pytest

from norton_drivers.adapters.mended_buses import SteadySocketcandBus
from norton_drivers.codecs.socketcand import BracketStream, SocketcandFrame, decode_request
from norton_drivers.errors import ConnectionFailedError
from norton_drivers.hardware import HardwareBackend
from norton_drivers.wiring import CanBusSettings

pytestmark = pytest.mark.wall_time


class Server:
    """Speaks as linux-can/socketcand does; ``requests`` holds what it was asked to send."""

    def __init__(self, *, greeting: bytes = b"< hi >", knows_remote: bool = True) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.requests: list[SocketcandFrame] = []
        self.client: socket.socket | None = None
        self._greeting = greeting
        self._knows_remote = knows_remote
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        try:
            self.client, _ = self._listener.accept()
        except OSError:
            return
        self.client.sendall(self._greeting)
        stream = BracketStream()
        while True:
            try:
                data = self.client.recv(4096)
            except OSError:
                return
            if not data:
                return
            stream.feed(data)
            while stream.texts:
                self._obey(stream.texts.popleft())

    def _obey(self, text: str) -> None:
        assert self.client is not None
        if text in ("open can0", "rawmode"):
            self.client.sendall(b"< ok >")
        elif text.startswith("open"):
            self.client.sendall(b"< error could not open bus >")
        elif text.startswith("sendrtr") and not self._knows_remote:
            self.client.sendall(b"< error unknown command >")
        else:
            self.requests.append(decode_request(text))

    def say(self, data: bytes) -> None:
        assert self.client is not None
        self.client.sendall(data)

    def close(self) -> None:
        for each in (self.client, self._listener):
            if each is not None:
                with suppress(OSError):  # closed already
                    each.shutdown(socket.SHUT_RDWR)
                each.close()
        self._thread.join()


@pytest.fixture
def server() -> Iterator[Server]:
    made = Server()
    yield made
    made.close()


def settings(server: Server, channel: str = "can0") -> CanBusSettings:
    return CanBusSettings("can0", "socketcand", channel, options={"host": "127.0.0.1", "port": server.port})


@pytest.fixture
def port(server):
    backend = HardwareBackend()
    yield backend.open_can(settings(server))
    backend.close()


def gather(port, count: int) -> list[can.Message]:
    got: list[can.Message] = []
    port.subscribe(lambda message, _arrival_ns: got.append(message))
    deadline_s = time.monotonic() + 2
    while len(got) < count and time.monotonic() < deadline_s:
        port.poll()
    return got


def wait_for(condition) -> None:
    deadline_s = time.monotonic() + 2
    while not condition() and time.monotonic() < deadline_s:
        time.sleep(0.005)
    assert condition()


def test_frames_both_ways(server, port):
    port.send(0x21, b"\1\2")
    port.send(0x123456, b"", extended=True)
    port.send(0x22, b"", remote=True)
    wait_for(lambda: len(server.requests) == 3)
    assert [(r.arbitration_id, r.data, r.extended, r.remote, r.length) for r in server.requests] == [
        (0x21, b"\1\2", False, False, 2),
        (0x123456, b"", True, False, 0),
        (0x22, b"", False, True, 8),
    ]
    server.say(b"< frame 021 1.5 0102 >< frame 00123456 1.6 >< rtr 022 1.7 8 >")
    got = gather(port, 3)
    assert [(m.arbitration_id, bytes(m.data), m.is_extended_id, m.is_remote_frame, m.dlc) for m in got] == [
        (0x21, b"\1\2", False, False, 2),
        (0x123456, b"", True, False, 0),
        (0x22, b"", False, True, 8),
    ]


def test_garbage_is_survived_and_counted(server, port):
    server.say(b"nonsense > < frame zzz 1.0 00 ><<<\xff\xfe>< frame 021 1.5 07 >< error 020 1.6 >")
    (message,) = gather(port, 1)
    assert bytes(message.data) == b"\7"
    wait_for(lambda: port.poll() or port.error_frames)
    assert port.troubles()["malformed messages"] >= 3
    assert port.troubles()["no acknowledgement"] == 1


def test_a_server_that_goes_is_a_lost_bus(server, port):
    server.close()
    with pytest.raises(ConnectionFailedError, match=r"bus can0: lost \(the server hung up\)"):
        gather(port, 1)


def test_an_old_server_without_remote_frames_is_told():
    server = Server(knows_remote=False)
    bus = SteadySocketcandBus("can0", host="127.0.0.1", port=server.port)
    bus.send(can.Message(arbitration_id=0x21, is_remote_frame=True, is_extended_id=False))
    wait_for(lambda: bus.recv(0) is None and any("old one" in words for words, n in bus.troubles().items() if n))
    bus.shutdown()
    server.close()


@pytest.mark.parametrize(
    ("greeting", "channel", "words"),
    [
        (b"< hi >", "can9", r"the server has no bus can9, or does not share it \(it said <error could not open bus>\)"),
        (b"SSH-2.0-OpenSSH_9.6\r\n<>", "can0", r"is no socketcand \(it said <>\)"),
    ],
)
def test_a_handshake_that_fails(greeting, channel, words):
    server = Server(greeting=greeting)
    with pytest.raises(ConnectionFailedError, match=rf"{words}\); start the server there, `socketcand -i {channel}"):
        HardwareBackend().open_can(settings(server, channel))
    server.close()


def test_nobody_there(server):
    server.close()
    with pytest.raises(ConnectionFailedError, match=r"nobody serves at 127\.0\.0\.1:\d+.*start the server there"):
        HardwareBackend().open_can(settings(server))
