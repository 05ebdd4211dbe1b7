"""Who answers on a half-duplex line, where the servo that a rig file names does not: asked at one baud rate."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from norton_drivers.codecs import dynamixel, feetech
from norton_drivers.codecs.half_duplex import Answer, AnswerStream
from norton_drivers.link import Link
from norton_drivers.ports import SerialPort

# All answer a broadcast one after another, by their ids; at 57600 baud this is enough for the first forty.
BROADCAST_WAIT_NS = 150_000_000
ONE_WAIT_NS = 5_000_000
FIRST_NODES = range(21)


@dataclass(frozen=True)
class Found:
    """``device`` in words, and what a rig file would say to reach it; nothing where this driver cannot."""

    device: str
    options: Mapping[str, Any] = field(default_factory=dict)


class _Listener:
    def __init__(self, port: SerialPort, answers: AnswerStream[Any]) -> None:
        self.heard: list[Answer] = []
        self._answers = answers
        port.subscribe(self._on_bytes)

    def _on_bytes(self, data: bytes, _arrival_ns: int) -> None:
        self.heard.extend(self._answers.feed(data))


def dynamixels(port: SerialPort, link: Link) -> Iterator[tuple[int, int]]:
    """Ids and model numbers of those that speak Protocol 2.0. Raises ConnectionFailedError."""
    dialect = dynamixel.Dialect()
    listener = _Listener(port, dialect.answers())
    port.send(dialect.ping(dynamixel.BROADCAST))
    _wait(link, BROADCAST_WAIT_NS)
    for answer in listener.heard:
        if len(answer.data) == 3:
            yield answer.node, int.from_bytes(answer.data[:2], "little")


def feetechs(port: SerialPort, link: Link) -> Iterator[tuple[int, bytes]]:
    """Ids and first registers of those that speak Feetech's protocol, or Dynamixel's Protocol 1.0; of the first ids
    alone. Raises ConnectionFailedError."""
    dialect = feetech.Dialect()
    listener = _Listener(port, dialect.answers())
    for node in FIRST_NODES:
        port.send(dialect.read(node, 0, 5))
        _wait(link, ONE_WAIT_NS)
    for answer in listener.heard:
        if len(answer.data) == 5:
            yield answer.node, answer.data


def _wait(link: Link, duration_ns: int) -> None:
    end_ns = link.clock.now_ns() + duration_ns
    while link.clock.now_ns() < end_ns:
        link.wait()
