"""Faults of wires: frames and bytes lost, late, doubled, out of order or wrong; adapters and buses that fail."""

from collections import deque
from collections.abc import Callable
from math import inf

import can

from norton_sim.connectors import CAN_ERR_PROTOCOL, TRANSMIT_QUEUE, CanConnector, Piece, Tamper, Trouble
from norton_sim.faults.schema import (
    BabblingNode,
    BusOff,
    Carriage,
    Corrupt,
    Delay,
    Drop,
    Dropout,
    Duplicate,
    Reorder,
    Unplugged,
)
from norton_sim.faults.stage import Injected, Stage, Undo
from norton_sim.world import World

# A classic frame of eight bytes with all the stuff bits that it can have, and the error frame before it is sent again.
FRAME_BITS = 135
ERROR_FRAME_BITS = 31


class Chance:
    """Which pieces are hit. A frame of the host's, which several plugs are offered, is hit for all of them or none."""

    def __init__(self, fault: Carriage, stage: Stage, injected: Injected) -> None:
        self._fault = fault
        self._draw = stage.random.random
        self._injected = injected
        self._token: object = None
        self._was_hit = False

    def hits(self, piece: Piece) -> bool:
        if piece.token is not None and piece.token is self._token:
            return self._was_hit
        fault, injected = self._fault, self._injected
        hit = (fault.count is None or injected.hits < fault.count) and self._draw() < fault.share
        injected.hits += hit
        self._token, self._was_hit = piece.token, hit
        return hit


class Queue:
    """Pieces that wait; nothing overtakes. Whoever takes the fault away lets them all go."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._waiting: deque[Piece] = deque()
        self._last_ns = 0

    def put(self, piece: Piece, wait_ns: int) -> None:
        self._last_ns = max(self._last_ns, self._world.now_ns + wait_ns)
        self._waiting.append(piece)
        self._world.at(self._last_ns, self._let_go)

    def empty(self) -> None:
        while self._waiting:
            self._let_go(self._world.now_ns)

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def _let_go(self, _stamp_ns: int) -> None:
        if self._waiting:
            piece = self._waiting.popleft()
            piece.forward(piece.data)


def drop(fault: Drop, stage: Stage, injected: Injected) -> Undo:
    chance = Chance(fault, stage, injected)

    def tamper(piece: Piece) -> None:
        if not chance.hits(piece):
            piece.forward(piece.data)

    return everywhere(fault.on, fault.towards, stage, lambda: (tamper, _nothing))


def duplicate(fault: Duplicate, stage: Stage, injected: Injected) -> Undo:
    chance = Chance(fault, stage, injected)

    def tamper(piece: Piece) -> None:
        piece.forward(piece.data)
        if chance.hits(piece):
            piece.forward(piece.data)

    return everywhere(fault.on, fault.towards, stage, lambda: (tamper, _nothing))


def delay(fault: Delay, stage: Stage, injected: Injected) -> Undo:
    chance = Chance(fault, stage, injected)
    return _late(fault, stage, chance.hits, round(fault.by_s * 1e9))


def reorder(fault: Reorder, stage: Stage, injected: Injected) -> Undo:
    chance = Chance(fault, stage, injected)

    def make() -> tuple[Tamper, Undo]:
        held: list[Piece] = []

        def let_go() -> None:
            while held:
                piece = held.pop()
                piece.forward(piece.data)

        def tamper(piece: Piece) -> None:
            if not held and chance.hits(piece):
                held.append(piece)
                return
            piece.forward(piece.data)
            let_go()

        return tamper, let_go

    return everywhere(fault.on, fault.towards, stage, make)


def corrupt(fault: Corrupt, stage: Stage, injected: Injected) -> Undo:
    chance = Chance(fault, stage, injected)
    bus = stage.bus_of(fault.on)
    if bus is not None and fault.crc != "missed":
        return _sent_again(fault, stage, chance, bus)

    def tamper(piece: Piece) -> None:
        # What carries no data has no bits to flip here.
        wrong = piece.data and chance.hits(piece)
        piece.forward(_flipped(piece.data, fault.bits, stage) if wrong else piece.data)

    return everywhere(fault.on, fault.towards, stage, lambda: (tamper, _nothing))


def _sent_again(fault: Corrupt, stage: Stage, chance: Chance, bus: str) -> Undo:
    """Every controller on the bus sees the wrong check sum: an error frame, and then the frame once more."""
    end, reported = stage.end(bus), list[object]([None])

    def caught(piece: Piece) -> bool:
        hit = chance.hits(piece)
        if hit and (piece.token is None or piece.token is not reported[0]):
            reported[0] = piece.token
            end.report_error(CAN_ERR_PROTOCOL)
        return hit

    return _late(fault, stage, caught, round((FRAME_BITS + ERROR_FRAME_BITS) * 1e9 / stage.bitrate_bit_s(bus)))


def _late(fault: Carriage, stage: Stage, hits: Callable[[Piece], bool], wait_ns: int) -> Undo:
    """What is hit comes later, and what follows it waits behind it."""

    def make() -> tuple[Tamper, Undo]:
        queue = Queue(stage.world)

        def tamper(piece: Piece) -> None:
            hit = hits(piece)
            if hit or queue:
                queue.put(piece, wait_ns if hit else 0)
            else:
                piece.forward(piece.data)

        return tamper, queue.empty

    return everywhere(fault.on, fault.towards, stage, make)


def _flipped(data: bytes, bits: int, stage: Stage) -> bytes:
    """With so many of its bits, chosen at random, the other way round."""
    flipped = bytearray(data)
    for place in stage.random.sample(range(8 * len(data)), min(bits, 8 * len(data))):
        flipped[place // 8] ^= 1 << place % 8
    return bytes(flipped)


def everywhere(on: str, towards: str, stage: Stage, make: Callable[[], tuple[Tamper, Undo]]) -> Undo:
    """Tamper with each direction ("host", "device" or "both") at every plug, with what ``make`` gives anew for each."""
    undos: list[Undo] = []
    for plug in stage.plugs(on):
        if towards != "device":
            tamper, let_go = make()
            undos += [plug.tamper(to_host=tamper), let_go]
        if towards != "host":
            tamper, let_go = make()
            undos += [plug.tamper(to_device=tamper), let_go]

    def undo() -> None:
        for each in undos:
            each()

    return undo


def _nothing() -> None:
    """Holds nothing back."""


# Frames that would have to wait longer find their sender's mailboxes full.
LONGEST_WAIT_NS = 10_000_000


def unplugged(fault: Unplugged, stage: Stage) -> Undo:
    end = stage.end(fault.on)
    end.suffer(Trouble.UNPLUGGED)
    return lambda: end.suffer(None)


def dropout(fault: Dropout, stage: Stage) -> Undo:
    return _cut(fault.on, stage)


def bus_off(fault: BusOff, stage: Stage) -> Undo:
    if stage.bus_of(fault.on) != fault.on:
        return _cut(fault.on, stage)
    end = stage.end(fault.on)
    end.suffer(Trouble.BUS_OFF)
    return lambda: end.suffer(None)


def babbling_node(fault: BabblingNode, stage: Stage, injected: Injected) -> Undo:
    babble = _Babble(fault, stage)
    gaps = _Gaps(fault, stage, injected)

    def make() -> tuple[Tamper, Undo]:
        queue = Queue(stage.world)

        def tamper(piece: Piece) -> None:
            wait_ns = gaps.wait_ns(piece)
            if wait_ns is not None:
                queue.put(piece, wait_ns)

        return tamper, queue.empty

    let_pass = everywhere(fault.on, "both", stage, make)

    def undo() -> None:
        babble.end()
        let_pass()
        stage.end(fault.on).suffer(None)

    return undo


def _cut(role: str, stage: Stage) -> Undo:
    (plug,) = stage.plugs(role)
    plug.cut()
    return plug.mend


def _frame_ns(fault: BabblingNode, stage: Stage) -> float:
    return FRAME_BITS * 1e9 / stage.bitrate_bit_s(fault.on)


class _Babble:
    """Frames from no known device, received by the host and by every device, one after the other."""

    def __init__(self, fault: BabblingNode, stage: Stage) -> None:
        self._world = stage.world
        self._plugs = [plug for plug in stage.plugs(fault.on) if isinstance(plug, CanConnector)]
        self._message = can.Message(arbitration_id=fault.arbitration_id, is_extended_id=False, data=bytes(8))
        self._period_ns = round(_frame_ns(fault, stage) / fault.load)
        self._going_on = True
        self._say(self._world.now_ns)

    def end(self) -> None:
        self._going_on = False

    def _say(self, stamp_ns: int) -> None:
        if not self._going_on or not self._plugs:
            return
        self._plugs[0].wire.to_host(self._message.arbitration_id, bytes(8), False, False)
        for plug in self._plugs:
            plug.overhear(self._message)
        self._world.at(stamp_ns + self._period_ns, self._say)


class _Gaps:
    """What is left of the bus for those who belong there; ``hits`` counts the frames that had to wait or were lost.

    A device keeps only what is new, and loses what would have to wait for long; the host's frames wait in its adapter's
    queue, which refuses more when it is full.
    """

    def __init__(self, fault: BabblingNode, stage: Stage, injected: Injected) -> None:
        self._world = stage.world
        self._injected = injected
        self._host = stage.end(fault.on)
        self._gap_ns = _frame_ns(fault, stage) / (1 - fault.load) if fault.load < 1 else inf
        self._free_ns = 0.0
        self._token: object = None
        self._wait_ns: int | None = None
        self._queued = 0  # of the host's

    def wait_ns(self, piece: Piece) -> int | None:
        """Until the frame has had its gap; None where it never gets one."""
        if piece.token is None:
            self._injected.hits += 1
            return self._next_ns(LONGEST_WAIT_NS)
        if piece.token is not self._token:
            self._injected.hits += 1
            self._token, self._wait_ns = piece.token, self._next_ns(inf)
            self._queue()
        return self._wait_ns

    def _next_ns(self, longest_ns: float) -> int | None:
        now_ns = self._world.now_ns
        wait_ns = max(self._free_ns - now_ns, 0.0) + self._gap_ns
        if wait_ns == inf or wait_ns > longest_ns:
            return None
        self._free_ns = now_ns + wait_ns
        return round(wait_ns)

    def _queue(self) -> None:
        self._queued += 1
        if self._queued >= TRANSMIT_QUEUE:
            self._host.suffer(Trouble.CROWDED)
        if self._wait_ns is not None:
            self._world.at(self._world.now_ns + self._wait_ns, self._sent)

    def _sent(self, _stamp_ns: int) -> None:
        self._queued -= 1
        self._host.suffer(None)
