"""How faults reach what passes a plug: each direction is a chain of functions, its end the wire or the device."""

from collections.abc import Callable
from typing import NamedTuple

import can

FrameSender = Callable[[int, bytes, bool], None]
MessageReceiver = Callable[[can.Message], None]
BytesPassage = Callable[[bytes], None]


class Piece(NamedTuple):
    """One frame's payload, or the bytes of one write, on its way through a plug.

    ``forward`` lets it pass, or something else in its place, now or later. The host's frames come to every plug on the
    bus: those know by the ``token`` that it is one frame.
    """

    data: bytes
    forward: BytesPassage
    token: object = None


Tamper = Callable[[Piece], None]


class Tampers:
    """Who tampers with what passes one plug; the first to come meets it first."""

    def __init__(self, changed: Callable[[], None]) -> None:
        self.to_host: list[Tamper] = []
        self.to_device: list[Tamper] = []
        self._changed = changed

    def add(self, to_host: Tamper | None, to_device: Tamper | None) -> Callable[[], None]:
        """Returns what takes them away again."""
        sides = [(self.to_host, to_host), (self.to_device, to_device)]
        added = [(chain, tamper) for chain, tamper in sides if tamper is not None]
        for chain, tamper in added:
            chain.append(tamper)
        self._changed()

        def remove() -> None:
            for chain, tamper in added:
                chain.remove(tamper)
            self._changed()

        return remove


def tampered_frames(send: FrameSender, tampers: list[Tamper]) -> FrameSender:
    """``send`` behind all of them."""
    for tamper in reversed(tampers):
        send = _frames_through(tamper, send)
    return send


def tampered_messages(receive: MessageReceiver, tampers: list[Tamper]) -> MessageReceiver:
    """``receive`` behind all of them."""
    for tamper in reversed(tampers):
        receive = _messages_through(tamper, receive)
    return receive


def tampered_bytes(passage: BytesPassage, tampers: list[Tamper]) -> BytesPassage:
    """``passage`` behind all of them."""
    for tamper in reversed(tampers):
        passage = _bytes_through(tamper, passage)
    return passage


def _frames_through(tamper: Tamper, send: FrameSender) -> FrameSender:
    return lambda arbitration_id, data, extended: tamper(
        Piece(data, lambda passed: send(arbitration_id, passed, extended))
    )


def _messages_through(tamper: Tamper, receive: MessageReceiver) -> MessageReceiver:
    return lambda message: tamper(
        Piece(bytes(message.data), lambda passed: receive(_with_data(message, passed)), message)
    )


def _bytes_through(tamper: Tamper, passage: BytesPassage) -> BytesPassage:
    return lambda data: tamper(Piece(data, passage))


def _with_data(message: can.Message, data: bytes) -> can.Message:
    if data == message.data:
        return message
    return can.Message(message.timestamp, message.arbitration_id, message.is_extended_id, data=data)
