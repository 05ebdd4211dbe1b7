"""A CANopen device's communication: network management, heartbeats sent and watched, emergencies, SDO, process data.

Source: CiA 301. As in maxon's EPOS4 (Firmware Specification, chapter 7), a device that has lost the heartbeat that it
watches leaves operation (1029h), and needs a reset of its communication before it forgets that.
"""

from collections.abc import Callable, Sequence

import can

from norton_drivers.codecs import canopen as protocol
from norton_drivers.codecs.canopen import NmtCommand, NmtState
from norton_drivers.codecs.common import CodecError
from norton_sim.firmware.canopen.objects import U8, U16, U32, Entry, Objects, SdoServer
from norton_sim.firmware.canopen.process_data import ReceivedPdo, SentPdo, Timer
from norton_sim.firmware.context import DeviceContext

BOOT_MS = 20.0
VENDOR, PRODUCT, REVISION = 0x2B1, 0x51, 0x00010002

ERROR_HEARTBEAT_LOST = 0x8130
ERROR_PDO_TOO_SHORT = 0x8210
_REGISTER_GENERIC, _REGISTER_COMMUNICATION = 0x01, 0x10
_COMMUNICATION_CLASS = 0x81


class CanopenNode:
    """``on_host_lost`` is called where the watched heartbeat is missing, ``on_stopped`` where the node is told to leave
    operation for good or to begin anew, and ``on_power_on`` at a restart.

    ``bus_lost`` says that the heartbeat was lost, and communication not reset since.
    """

    def __init__(self, context: DeviceContext, node: int, device_type: int, name: str) -> None:
        self.objects = Objects()
        self.state = NmtState.PRE_OPERATIONAL
        self.bus_lost = False
        self.on_host_lost: Callable[[], None] = _nothing
        self.on_stopped: Callable[[], None] = _nothing
        self.on_power_on: Callable[[], None] = _nothing
        self.id = node
        self._context = context
        self._world = context.world
        self._connector = context.can_connector()
        self._heartbeat = self._timer()
        self._boot = self._timer()
        self._received: list[ReceivedPdo] = []
        self._sent: list[SentPdo] = []
        self._routes: dict[int, Callable[[bytearray], None]] = {}
        self._watch_round = 0
        self._watched_heard_ns: int | None = None  # None until the first heartbeat
        self._server = SdoServer(self.objects, lambda data: self._connector.send(protocol.sdo_answer_id(node), data))
        self._add_objects(device_type, name)
        self._route()
        self._connector.on_frame(self._receive)

    @property
    def operational(self) -> bool:
        return self.state is NmtState.OPERATIONAL

    # ---- What the device is made of ------------------------------------------------------------------------------

    def add_received(self, number: int, mapped: Sequence[int]) -> None:
        """A PDO that the device receives, with its mapping at power-on."""
        identifier = protocol.receive_pdo_id(self.id, number)
        self._received.append(
            ReceivedPdo(self.objects, 0x1400 + number - 1, identifier, mapped, locked=lambda: self.operational)
        )

    def add_sent(self, number: int, mapped: Sequence[int], identifier: int | None = None) -> SentPdo:
        """A PDO that the device sends, with its mapping and identifier at power-on."""
        pdo = SentPdo(
            self.objects,
            0x1800 + number - 1,
            identifier or protocol.transmit_pdo_id(self.id, number),
            mapped,
            locked=lambda: self.operational,
            timer=self._timer(),
            send=self._connector.send,
        )
        self._sent.append(pdo)
        return pdo

    def _timer(self) -> Timer:
        return Timer(self._world, self._context.clock_ppm)

    def _add_objects(self, device_type: int, name: str) -> None:
        add = self.objects.add
        add(0x1000, 0, Entry(U32, device_type))
        self._register = add(0x1001, 0, Entry(U8, 0))
        for index, text in ((0x1008, name), (0x1009, "sim"), (0x100A, "1.2.0")):
            self.objects.add_text(index, text)
        add(0x1016, 0, Entry(U8, 1))
        self._watched = add(0x1016, 1, Entry(U32, 0, writable=True, written=self._watch_written))
        add(0x1017, 0, Entry(U16, 0, writable=True, written=self._heartbeat_written))
        for subindex, value in enumerate((4, VENDOR, PRODUCT, REVISION, self.id)):
            add(0x1018, subindex, Entry(U32 if subindex else U8, value))
        add(0x1029, 0, Entry(U8, 1))
        self._on_error = add(0x1029, 1, Entry(U8, 0, writable=True))

    # ---- Network management --------------------------------------------------------------------------------------

    def restart(self) -> None:
        """As after a failing supply: everything forgotten, a boot-up message when it is back."""
        self._reset_communication()
        self.on_power_on()

    def emergency(self, code: int) -> None:
        """Report an error; 0 says that all are gone."""
        self._register.value = 0
        if code:
            communication = code >> 8 == _COMMUNICATION_CLASS
            self._register.value = _REGISTER_GENERIC | (_REGISTER_COMMUNICATION if communication else 0)
        if self.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL):
            data = protocol.Emergency(code, self._register.value).encode()
            self._connector.send(protocol.emergency_id(self.id), data)

    def _on_order(self, data: bytearray) -> None:
        order = protocol.NmtOrder.decode(data)
        if order.node not in (0, self.id):
            return
        match order.command:
            case NmtCommand.START:
                self._enter(NmtState.OPERATIONAL)
            case NmtCommand.STOP:
                self.on_stopped()
                self._enter(NmtState.STOPPED)
            case NmtCommand.PRE_OPERATIONAL:
                self._enter(NmtState.PRE_OPERATIONAL)
            case NmtCommand.RESET:
                self.restart()
            case NmtCommand.RESET_COMMUNICATION:
                self.on_stopped()
                self._reset_communication()

    def _enter(self, state: NmtState) -> None:
        if state is self.state:
            return
        self.state = state
        if state is NmtState.OPERATIONAL:
            for pdo in (*self._received, *self._sent):
                pdo.begin()
        else:
            for sent in self._sent:
                sent.end()
        self._route()

    def _reset_communication(self) -> None:
        self._enter(NmtState.BOOT_UP)
        self._heartbeat.stop()
        self._watch_round += 1
        self.bus_lost = False
        self.objects.reset_communication()
        self._boot.start(BOOT_MS, self._come_up)

    def _come_up(self) -> None:
        self._boot.stop()
        self._connector.send(protocol.heartbeat_id(self.id), protocol.heartbeat(NmtState.BOOT_UP))
        self._enter(NmtState.PRE_OPERATIONAL)

    # ---- Heartbeats ----------------------------------------------------------------------------------------------

    def _heartbeat_written(self, period_ms: int) -> None:
        self._heartbeat.start(period_ms, self._send_heartbeat)

    def _send_heartbeat(self) -> None:
        self._connector.send(protocol.heartbeat_id(self.id), protocol.heartbeat(self.state))

    def _watch_written(self, value: int) -> None:
        self._watched_heard_ns = None  # watched from the next heartbeat on
        self._watch_round += 1
        self._watched.value = value
        self._route()

    def _on_watched(self, _data: bytearray) -> None:
        first = self._watched_heard_ns is None
        self._watched_heard_ns = self._world.now_ns
        if first:
            self._look_later(self._watch_round)

    def _look_later(self, watch_round: int) -> None:
        """Once a timeout, instead of at each of many heartbeats."""
        timeout_ns = (self._watched.value & 0xFFFF) * 1_000_000
        self._world.at((self._watched_heard_ns or 0) + timeout_ns, lambda stamp_ns: self._look(stamp_ns, watch_round))

    def _look(self, stamp_ns: int, watch_round: int) -> None:
        if watch_round != self._watch_round or self._watched_heard_ns is None:
            return
        if stamp_ns < self._watched_heard_ns + (self._watched.value & 0xFFFF) * 1_000_000:
            self._look_later(watch_round)
            return
        self._watched_heard_ns = None
        self.bus_lost = True
        self.emergency(ERROR_HEARTBEAT_LOST)
        self.on_host_lost()
        if self._on_error.value == 0 and self.operational:
            self._enter(NmtState.PRE_OPERATIONAL)
        elif self._on_error.value == 2:
            self._enter(NmtState.STOPPED)

    # ---- What it receives ----------------------------------------------------------------------------------------

    def _route(self) -> None:
        """Who gets which identifier, in the state it is in."""
        self._routes = {protocol.NMT_ID: self._on_order}
        if self.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL):
            self._routes[protocol.sdo_request_id(self.id)] = self._server.receive
        watched = self._watched.value >> 16 & 0x7F
        if watched and self._watched.value & 0xFFFF:
            self._routes[protocol.heartbeat_id(watched)] = self._on_watched
        if self.state is NmtState.OPERATIONAL:
            self._routes[protocol.SYNC_ID] = self._on_sync
            for pdo in self._received:
                if pdo.enabled:
                    self._routes[pdo.identifier] = self._receiver(pdo)

    def _receiver(self, pdo: ReceivedPdo) -> Callable[[bytearray], None]:
        def receive(data: bytearray) -> None:
            if not pdo.receive(data):
                self.emergency(ERROR_PDO_TOO_SHORT)

        return receive

    def _on_sync(self, _data: bytearray) -> None:
        for received in self._received:
            received.sync()
        for sent in self._sent:
            sent.sync()

    def _receive(self, message: can.Message) -> None:
        route = self._routes.get(message.arbitration_id)
        if route is None or message.is_extended_id or message.is_remote_frame or self.state is NmtState.BOOT_UP:
            return
        try:
            route(message.data)
        except CodecError:
            return  # what cannot be read is not taken notice of


def _nothing() -> None:
    """Nobody is told."""
