"""What holds for every driver: it is found by its name, declares its options, and says who is there, or who is not."""

import os
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from random import Random
from typing import Any, ClassVar, Protocol, cast

import can
import pytest

from norton_bench.rig.driver_options import declared_by
from norton_drivers import registry
from norton_drivers.codecs.can_errors import ErrorClass
from norton_drivers.errors import DeviceError, WiringError
from norton_drivers.link import Link
from norton_drivers.ports import Backend, CanPort, Clock, SerialLine, SerialPort
from norton_drivers.wiring import CanBusSettings, DeviceSettings


# What a contract needs of the device that a driver is tested against: an emulation, or a script of it.
#
# Values are in the device's own positive sense: what ``direction`` makes of them is what is tested.
class EmulatedDevice(Protocol):
    """Any device."""

    def vanish(self) -> None:
        """From now on say nothing and hear nothing, as with the plug pulled."""
        ...


class EmulatedAmplifier(EmulatedDevice, Protocol):
    """A drive."""

    @property
    def armed(self) -> bool:
        """Whether it drives its motor now, even with a command of zero."""
        ...

    @property
    def command(self) -> float:
        """What it acts upon now, in the driver's ``command_unit``; 0 where it is not armed."""
        ...

    def turn(self, position_rad: float, velocity_rad_s: float) -> None:
        """Let the shaft be there, and turn so fast."""
        ...


class EmulatedTorqueSensor(EmulatedDevice, Protocol):
    """A torque sensor."""

    def twist(self, torque_nm: float) -> None:
        """From now on measure this torque."""
        ...


Device = EmulatedAmplifier | EmulatedTorqueSensor


@dataclass(frozen=True)
class SetUp:
    """An emulated device at the end of a backend's wire, and how a rig file would name it.

    ``backend`` may be a :class:`ScriptedWorld`, the simulated backend, or the hardware's.
    """

    backend: Backend
    settings: DeviceSettings
    emulated: Device
    buses: tuple[CanBusSettings, ...] = ()

    @property
    def address(self) -> str:
        """The bus or port that every complaint about the device must name."""
        return self.settings.bus or self.settings.port or ""


JUNK_AT_A_TIME = 40


class FaultProxy:
    """A proxy between a driver and its port: counts what is sent, lets junk arrive, disconnects.

    A backend around ``inner``. ``sent`` counts frames and chunks that went out.
    """

    def __init__(self, inner: Backend) -> None:
        self.sent = 0
        self.unplugged = False
        self.clock: Clock = inner.clock
        self.lock_step = inner.lock_step
        self._inner = inner
        self._buses: list[_ProxiedBus] = []
        self._lines: list[_ProxiedLine] = []

    def open_can(self, settings: CanBusSettings) -> CanPort:
        port = self._inner.open_can(settings)
        bus = _ProxiedBus(port.bus, self)
        self._buses.append(bus)
        port.bus = cast(can.BusABC, bus)
        return port

    def open_serial(self, port: str, baud: int) -> SerialPort:
        opened = self._inner.open_serial(port, baud)
        line = _ProxiedLine(opened.line, self)
        self._lines.append(line)
        opened.line = line
        return opened

    def close(self) -> None:
        self._inner.close()

    def babble(self, random: Random) -> None:
        """Let frames of all kinds and bytes arrive that nobody sent, many with identifiers that were heard before."""
        now_s = self.clock.now_ns() * 1e-9
        for bus in self._buses:
            bus.junk.extend(_junk_frame(random, bus.heard, now_s) for _ in range(JUNK_AT_A_TIME))
        for line in self._lines:
            line.junk += _junk_bytes(random, line.heard)


class _ProxiedBus:
    """As much of a bus as a port uses; the rest is the inner one's."""

    def __init__(self, inner: can.BusABC, proxy: FaultProxy) -> None:
        self.junk: deque[can.Message] = deque()
        self.heard: dict[int, can.Message] = {}
        self._inner = inner
        self._meddler = proxy

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        _check_plug(self._meddler, lambda: can.CanOperationError("No such device"))
        self._meddler.sent += 1
        self._inner.send(message, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        _check_plug(self._meddler, lambda: can.CanOperationError("No such device"))
        if self.junk:
            return self.junk.popleft()
        message = self._inner.recv(timeout)
        if message is not None:
            self.heard[message.arbitration_id] = message
        return message


class _ProxiedLine:
    def __init__(self, inner: SerialLine, proxy: FaultProxy) -> None:
        self.junk = b""
        self.heard = b""  # the last that was read
        self._inner = inner
        self._meddler = proxy

    @property
    def in_waiting(self) -> int:
        _check_plug(self._meddler, lambda: OSError("Input/output error"))
        return len(self.junk) or self._inner.in_waiting

    def read(self, size: int = 1) -> bytes:
        if self.junk:
            data, self.junk = self.junk[:size], self.junk[size:]
            return data
        data = self._inner.read(size)
        self.heard = data or self.heard
        return data

    def write(self, data: bytes, /) -> int | None:
        _check_plug(self._meddler, lambda: OSError("Input/output error"))
        self._meddler.sent += 1
        return self._inner.write(data)

    def close(self) -> None:
        self._inner.close()


def _check_plug(proxy: FaultProxy, error: Callable[[], Exception]) -> None:
    if proxy.unplugged:
        raise error()


def _junk_frame(random: Random, received: dict[int, can.Message], now_s: float) -> can.Message:
    extended = random.random() < 0.3
    identifier = random.randrange(1 << (29 if extended else 11))
    if received and random.random() < 0.7:
        like = received[random.choice(sorted(received))]
        identifier, extended = like.arbitration_id, like.is_extended_id
    remote, error = random.random() < 0.1, random.random() < 0.1
    return can.Message(
        timestamp=now_s,
        # An error frame that says bus-off is no junk, but a lost bus.
        arbitration_id=identifier & ~ErrorClass.BUS_OFF if error else identifier,
        is_extended_id=extended,
        is_remote_frame=remote,
        is_error_frame=error,
        data=random.randbytes(random.randrange(9)),
    )


def _junk_bytes(random: Random, received: bytes) -> bytes:
    """Noise, and pieces of what was really said with bits that flipped."""
    piece = bytearray(received[: random.randrange(len(received) + 1)])
    for _ in range(random.randrange(3)):
        if piece:
            piece[random.randrange(len(piece))] ^= 1 << random.randrange(8)
    return random.randbytes(random.randrange(60)) + bytes(piece) + random.randbytes(random.randrange(10))


SHORT_S = 0.3
# What a driver may take beyond the time it was given: a frame on its way, a poll.
GRACE_S = 0.5
ROUNDS_OF_JUNK = 200

_LOADED_QUIETLY = """
import os, sys, threading
from norton_drivers import registry
def opened():
    return len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0
before = opened(), threading.active_count()
factory = registry.load(sys.argv[1], sys.argv[2], asked_by="driver")
assert callable(factory), f"the entry point names {factory!r}, which cannot be called"
after = opened(), threading.active_count()
assert after == before, f"importing it opened files or started threads: {before} before, {after} after"
"""


@dataclass
class Plugged:
    """What holds for every driver: it is found by its name, declares its options, and says who is there, or who is
    not.

    An open driver, the device at its far end, and what lies between.
    """

    set_up: SetUp
    device: Any
    link: Link
    proxy: FaultProxy

    @property
    def emulated(self) -> Any:
        return self.set_up.emulated

    @property
    def now_ns(self) -> int:
        return self.link.clock.now_ns()

    def wait(self, duration_s: float) -> None:
        """Let time pass, polling every millisecond."""
        end_ns = self.now_ns + round(duration_s * 1e9)
        while self.now_ns < end_ns:
            self.link.wait()

    def endure_junk(self) -> None:
        """Let junk arrive for a while, then none."""
        random = Random(1)
        for _ in range(ROUNDS_OF_JUNK):
            self.wait(0.002)
            self.proxy.babble(random)
        self.wait(0.1)

    def assert_told(self, sentence: object) -> None:
        """An error's text is one line, and says which device it is of and where that is connected."""
        text = str(sentence)
        assert "\n" not in text, f"more than one line: {text}"
        assert self.set_up.settings.role in text, f"does not say which device: {text}"
        assert self.set_up.address in text, f"does not say where it is connected: {text}"


class Plug(Protocol):
    def __call__(self, direction: int = 1) -> Plugged: ...


class DriverContract:
    """Base of both contracts. Subclasses say in :meth:`set_up` what is tested."""

    group: ClassVar[str]

    def set_up(self, direction: int) -> SetUp:
        """A fresh backend with the device at its far end, mounted with ``direction`` (1 or -1)."""
        raise NotImplementedError("say in set_up(self, direction) which driver, and what is at its far end")

    @staticmethod
    def open_driver(set_up: SetUp, link: Link) -> Any:
        raise NotImplementedError

    @contextmanager
    def plugging(self) -> Iterator[Plug]:
        """What opens the driver, with the device plugged in; everything is closed again at the end."""
        with ExitStack() as stack:

            def plug(direction: int = 1) -> Plugged:
                set_up = self.set_up(direction)
                proxy = FaultProxy(set_up.backend)
                stack.callback(proxy.close)
                link = Link(proxy, set_up.buses)
                stack.callback(link.close)
                return Plugged(set_up, self.open_driver(set_up, link), link, proxy)

            yield plug

    @pytest.fixture
    def plug(self) -> Iterator[Plug]:
        with self.plugging() as plug:
            yield plug

    @pytest.fixture
    def plugged(self, plug: Plug) -> Plugged:
        return plug()

    # ---- How it is found -----------------------------------------------------------------------------------------

    def test_its_entry_point_is_listed(self) -> None:
        assert self.set_up(1).settings.driver in registry.names(self.group)

    def test_importing_it_opens_and_starts_nothing(self) -> None:
        arguments = [sys.executable, "-c", _LOADED_QUIETLY, self.group, self.set_up(1).settings.driver]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        done = subprocess.run(arguments, env=environment, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")

    def test_its_options_are_declared(self) -> None:
        declared = declared_by(self.group, self.set_up(1).settings.driver)
        assert declared.model is not None, "its module has no subclass of norton_drivers.wiring.DeviceOptions"
        known = {field.alias or name for name, field in declared.model.model_fields.items()}
        assert set(declared.units) <= known, "OPTION_UNITS names options that are none"
        assert set(declared.files) <= known, "OPTION_FILES names options that are none"

    def test_an_option_that_is_none_is_refused_in_a_sentence(self) -> None:
        set_up = self.set_up(1)
        options = {**set_up.settings.options, "no_such_option": 1}
        wrong = replace(set_up, settings=replace(set_up.settings, options=options))
        link = Link(set_up.backend, set_up.buses)
        with pytest.raises(WiringError) as caught:
            self.open_driver(wrong, link)
        link.close()
        set_up.backend.close()
        assert "no_such_option" in str(caught.value)
        assert set_up.settings.role in str(caught.value)
        assert "\n" not in str(caught.value)

    # ---- Who is there --------------------------------------------------------------------------------------------

    def test_it_says_who_is_there(self, plugged: Plugged) -> None:
        identity = plugged.device.identify()
        assert identity.driver == plugged.set_up.settings.driver
        assert plugged.set_up.address in identity.address
        assert plugged.device.role == plugged.set_up.settings.role

    def test_that_nobody_is_there_is_told_in_time(self, plugged: Plugged) -> None:
        plugged.emulated.vanish()
        plugged.wait(0.05)  # what was on its way
        begun_ns = plugged.now_ns
        with pytest.raises(DeviceError) as caught:
            plugged.device.identify(SHORT_S)
        plugged.assert_told(caught.value)
        assert (plugged.now_ns - begun_ns) * 1e-9 < SHORT_S + GRACE_S

    def test_no_junk_makes_it_raise(self, plugged: Plugged) -> None:
        """Frames and bytes of all kinds, true ones between them; afterwards it still knows its device."""
        plugged.endure_junk()
        plugged.device.identify()
