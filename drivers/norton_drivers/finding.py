"""Who answers on a serial line: each driver asks for its own kind, at the baud rate at which the port is open."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from norton_drivers.link import Link
from norton_drivers.ports import SerialPort

ANSWER_NS = 60_000_000


@dataclass(frozen=True)
class Found:
    """``device`` in words, and what a rig file would say to reach it beside driver and baud rate."""

    device: str
    options: Mapping[str, Any] = field(default_factory=dict)


def answers_to(question: bytes, port: SerialPort, link: Link, wait_ns: int = ANSWER_NS) -> bytes:
    """All that comes within ``wait_ns``. Raises ConnectionFailedError."""
    heard = bytearray()
    port.subscribe(lambda data, _arrival_ns: heard.extend(data))
    port.send(question)
    end_ns = link.clock.now_ns() + wait_ns
    while link.clock.now_ns() < end_ns:
        link.wait()
    return bytes(heard)
