"""Telling moteus controllers from others on a bus."""

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from typing import Any

import can

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.moteus import ASK_MODE, Register
from norton_drivers.codecs.multiplex import BROADCAST, NODE_MAX, Address, Kind, Resolution, Subframe, subframes
from norton_drivers.readings import RawFrame
from norton_drivers.registry import Question, Recognised

_DEVICE = "a moteus controller"
_MODE = Subframe(Kind.REPLY, Register.MODE, Resolution.INT8, 1).encode()


def recognise(message: can.Message, options: Mapping[str, Any]) -> Recognised | None:
    """A reply that begins with the mode is sure, in a classical frame where it has nothing else; what asks is another
    host's."""
    address = Address.of(message.arbitration_id)
    if message.is_remote_frame or address.destination > BROADCAST or not message.data:
        return None
    try:
        parts = list(subframes(message.data))
    except CodecError:
        return None
    prefix = {"prefix": address.prefix} if address.prefix or "prefix" in options else {}
    tells_mode = message.data[:2] == _MODE and (message.is_fd or len(message.data) == len(_MODE) + 1)
    if tells_mode and not address.asks and 1 <= address.source <= NODE_MAX:
        return Recognised(_DEVICE, "reply", {"node": address.source, **prefix})
    if not (message.is_fd and parts):
        return None
    if address.asks:
        return Recognised(_DEVICE, "command", {"node": address.destination, **prefix}, sure=False, from_host=True)
    return Recognised(_DEVICE, "reply", {"node": address.source, **prefix}, sure=False)


def answers(question: RawFrame, frame: RawFrame) -> bool:
    """A reply goes from whom was asked to who asked, and has the registers that were asked for."""
    asked, answered = Address.of(question.arbitration_id), Address.of(frame.arbitration_id)
    wanted = Address(asked.destination, asked.source, prefix=asked.prefix)
    if not asked.asks or frame.remote or answered != wanted:
        return False
    registers = _registers(question.data, Kind.READ)
    return bool(registers) and registers == _registers(frame.data, Kind.REPLY)


def _registers(data: bytes, kind: Kind) -> list[int]:
    """The first of each row of them."""
    with suppress(CodecError):
        return [part.register for part in subframes(data) if isinstance(part, Subframe) and part.kind is kind]
    return []


def probes(options: Mapping[str, Any], heard: Collection[int]) -> Iterator[Question]:  # noqa: ARG001
    """Every controller is asked for its mode, in a frame that classical buses carry, too."""
    for node in range(1, NODE_MAX + 1):
        address = Address(options.get("host_node", 0), node, asks=True, prefix=options.get("prefix", 0))
        yield Question(address.identifier, ASK_MODE, address.extended)
