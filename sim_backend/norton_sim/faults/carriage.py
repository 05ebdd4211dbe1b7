"""Faults of what is carried: frames and bytes that are lost, late, doubled, out of order or wrong."""

from collections import deque
from collections.abc import Callable

from norton_sim.connectors import Piece, Tamper
from norton_sim.faults.schema import Carriage, Corrupt, Delay, Drop, Duplicate, Reorder
from norton_sim.faults.stage import Injected, Stage, Undo
from norton_sim.transport import CAN_ERR_PROTOCOL
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
