"""What is known of one of python-can's interfaces: mistakes in its settings, obstacles, how to open it, its state."""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import can

from norton_drivers.wiring import CanBusSettings


class Health(Protocol):
    """The state of an open bus, as it reports it."""

    def ask(self) -> None:
        """Ask the adapter, where it can be asked; called about once a second. Raises can.CanError, OSError."""
        ...

    def troubles(self) -> Mapping[str, int]:
        """What went wrong since the bus was opened, in words, and how often."""
        ...

    @property
    def off_bus(self) -> str | None:
        """How it is known that the controller takes no part any more; None while it does."""
        ...


class LinkError(can.CanOperationError):
    """A bus refused, for a known reason; ``mend`` is the half sentence with the remedy."""

    def __init__(self, reason: str, mend: str) -> None:
        super().__init__(reason)
        self.mend = mend


class FullQueueError(LinkError):
    """Frames come faster than the bus takes them; this one is lost."""


# A key of the rig file's section, and what is wrong with it, with the remedy.
Mistake = tuple[str, str]


def no_mistakes(_settings: CanBusSettings) -> Iterator[Mistake]:
    """Nothing that the rig file could say is known to be wrong."""
    return iter(())


def no_remarks(_settings: CanBusSettings) -> Iterator[str]:
    """Nothing is known that might become a trouble."""
    return iter(())


def no_obstacle(_settings: CanBusSettings) -> str | None:
    """Nothing can be seen before it is tried."""
    return None


def own_health(bus: can.BusABC) -> Health:
    """Of a bus that tells itself."""
    return bus  # type: ignore[return-value]


@dataclass
class StateOnly:
    """Of a bus that at most knows its state, as python-can names it."""

    bus: can.BusABC

    def ask(self) -> None:
        """The state needs no question."""

    def troubles(self) -> Mapping[str, int]:
        return {}

    @property
    def off_bus(self) -> str | None:
        return "its state is ERROR" if self.bus.state is can.BusState.ERROR else None


def as_python_can_does(settings: CanBusSettings, **changed: Any) -> can.BusABC:
    """Open with ``settings``; ``changed`` goes before the options. Raises whatever the interface does.

    Without python-can's own configuration files: the rig file alone says what is opened.
    """
    arguments = {**bus_arguments(settings), **changed}
    return can.Bus(interface=settings.interface, ignore_config=True, **arguments)


def bus_arguments(settings: CanBusSettings) -> dict[str, Any]:
    """What the rig file says, by the names of python-can's buses."""
    arguments: dict[str, Any] = {"channel": settings.channel, "bitrate": settings.bitrate_bit_s}
    if settings.fd:
        arguments |= {"fd": True, "data_bitrate": settings.data_bitrate_bit_s or settings.bitrate_bit_s}
    return {**arguments, **settings.options}


def generic_mend(_settings: CanBusSettings, error: Exception) -> str:
    """For an interface of which nothing special is known."""
    if isinstance(error, (ImportError, can.CanInterfaceNotImplementedError, NameError)):
        return "install the library of the adapter's maker, see python-can's page on this interface"
    return "is the adapter plugged in, and its driver installed?"


@dataclass(frozen=True)
class Adapter:
    """One interface.

    ``fd`` is whether CAN FD frames pass it. ``mistakes`` are told from the rig file alone, an ``obstacle`` from the
    machine, and ``remarks`` where the bus works but may not for long; ``mend`` is the half sentence after a failure to
    open. ``options`` are python-can's names, against which a misspelling is noticed.
    """

    channel: str = "the adapter's channel"
    install: str = ""  # what must be there
    options: tuple[str, ...] = ()
    fd: bool = False
    mistakes: Callable[[CanBusSettings], Iterator[Mistake]] = no_mistakes
    obstacle: Callable[[CanBusSettings], str | None] = no_obstacle
    remarks: Callable[[CanBusSettings], Iterator[str]] = no_remarks
    open: Callable[[CanBusSettings], can.BusABC] = as_python_can_does
    mend: Callable[[CanBusSettings, Exception], str] = generic_mend
    health: Callable[[can.BusABC], Health] = StateOnly
    marks_own_frames: bool = True  # a frame that is not marked as received is one that was sent from here
    linux_error_frames: bool = False  # error frames are laid out as Linux has them


@contextmanager
def quiet_python_can() -> Iterator[None]:
    """Inside, python-can says nothing of its own on standard error: every failure is told in our sentence."""
    logger = logging.getLogger("can")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)
