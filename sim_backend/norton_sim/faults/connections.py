"""Faults of connections: adapters, controllers and cables that are gone, and a bus that somebody else fills."""

from math import inf

import can

from norton_sim.connectors import CanConnector, Piece, Tamper
from norton_sim.faults.carriage import FRAME_BITS, Queue, everywhere
from norton_sim.faults.schema import BabblingNode, BusOff, Dropout, Unplugged
from norton_sim.faults.stage import Injected, Stage, Undo
from norton_sim.transport import TRANSMIT_QUEUE, Trouble

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
    """Frames of nobody's, heard by the host and by every device, one after the other."""

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
        self._plugs[0].wire.to_host(self._message.arbitration_id, bytes(8), False)
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
