"""A bus's CANopen master: hands frames to the devices they are from, sends SYNC and the heartbeat that devices watch.

python-canopen speaks SDO and network management through it, without the threads that it would start by itself: what
arrives comes from our port when that is polled, and what it sends leaves by our port.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass

import can
import canopen

from norton_drivers.codecs import canopen as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.errors import WiringError
from norton_drivers.link import Link
from norton_drivers.ports import CanPort
from norton_drivers.wiring import DeviceSettings

FrameHandler = Callable[[bytearray, int], None]

# A poll that comes a little early still asks for the tick's SYNC.
_SYNC_EARLY = 0.75
# So often within the shortest time that a device waits for it; a lost frame or two then do no harm.
_HEARTBEATS_PER_TIMEOUT = 5


class _PortNetwork(canopen.Network):
    """python-canopen's network on a port of ours."""

    def __init__(self, port: CanPort) -> None:
        super().__init__()
        self._port = port

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Raises ConnectionFailedError."""
        self._port.send(can_id, bytes(data), remote=remote)


@dataclass
class Listener:
    """Who wants the frames of one identifier; ``malformed`` is called where one cannot be decoded."""

    role: str
    handle: FrameHandler
    malformed: Callable[[], None]


class Master:
    """``node`` is the master's own node id: devices may watch its heartbeat, which says that it is operational.

    The heartbeat is sent from :meth:`beat`, which drivers call with their commands: if the loop stands still, it
    stops. SYNC is sent when the ports are polled in a tick. Frames of the bus's own echo are from no device and are
    passed over.
    """

    def __init__(self, port: CanPort, link: Link, node: int) -> None:
        # It says on standard error what it raises too.
        logging.getLogger("canopen").setLevel(logging.CRITICAL)
        self.node = node
        self.network = _PortNetwork(port)
        self.port = port
        self._link = link
        self._clock = link.clock
        self._listeners: dict[int, Listener] = {}
        self._sync_ns = 0  # 0: nobody wants it
        self._next_sync_ns = 0
        self._beat_ns = 0  # 0: nobody watches
        self._next_beat_ns = 0
        self._heartbeat = (protocol.heartbeat_id(node), protocol.heartbeat(protocol.NmtState.OPERATIONAL))
        port.subscribe(self._on_frame)
        link.questions.append(self._sync)

    def listen(self, identifier: int, listener: Listener) -> None:
        """Give a device its frames. Raises WiringError where another device has them already."""
        taken = self._listeners.get(identifier)
        if taken is not None:
            raise WiringError(
                f"[{listener.role}] identifier 0x{identifier:03X} on {self.port.name} belongs to [{taken.role}] "
                "already; give every device a node id of its own"
            )
        self._listeners[identifier] = listener

    def want_sync(self, period_s: float, role: str) -> None:
        """Send SYNC so often from now on. Raises WiringError where another device wants another period."""
        period_ns = round(period_s * 1e9)
        if self._sync_ns not in (0, period_ns):
            raise WiringError(
                f"[{role}] wants a SYNC every {period_s * 1e3:g} ms, another device on {self.port.name} every "
                f"{self._sync_ns / 1e6:g} ms; a bus has only one"
            )
        self._sync_ns = period_ns

    def want_heartbeat(self, timeout_s: float) -> None:
        """A device will miss our heartbeat after ``timeout_s``."""
        period_ns = round(timeout_s * 1e9 / _HEARTBEATS_PER_TIMEOUT)
        self._beat_ns = min(self._beat_ns, period_ns) if self._beat_ns else period_ns

    def beat_at_once(self) -> None:
        """Send our heartbeat with the next command: a device watches it only once it has heard it."""
        self._next_beat_ns = 0

    def beat(self) -> None:
        """Send our heartbeat where it is due. Raises ConnectionFailedError."""
        if not self._beat_ns:
            return
        now_ns = self._clock.now_ns()
        if now_ns >= self._next_beat_ns:
            self._next_beat_ns = now_ns + self._beat_ns
            self.port.send(*self._heartbeat)

    def _sync(self) -> None:
        if not self._sync_ns or self._link.reads_ahead:
            return
        now_ns = self._clock.now_ns()
        if now_ns >= self._next_sync_ns:
            self._next_sync_ns = now_ns + round(_SYNC_EARLY * self._sync_ns)
            self.port.send(protocol.SYNC_ID, b"")

    def _on_frame(self, message: can.Message, arrival_ns: int) -> None:
        listener = self._listeners.get(message.arbitration_id)
        if listener is None or message.is_extended_id or message.is_remote_frame:
            return
        try:
            listener.handle(message.data, arrival_ns)
        except CodecError:
            listener.malformed()


def master_of(settings: DeviceSettings, link: Link, node: int) -> Master:
    """The one master of the device's bus. Raises WiringError where devices want it to have different node ids."""
    port = link.can_port(settings)
    master = link.shared(("CANopen master", port.name), lambda: Master(port, link, node))
    if master.node != node:
        raise WiringError(
            f"[{settings.role}] master_node = {node}, but another device on {port.name} has {master.node}; a bus has "
            "only one master"
        )
    return master
