"""Wires in simulated time: a CAN bus and a serial line whose far end is the emulated firmware.

The host meets them as it meets hardware: a python-can bus and the part of pyserial's ``Serial`` that is used.
"""

from collections import deque

import can
from can.typechecking import CanFilters

from norton_sim.connectors import (
    BITS_PER_BYTE,
    CAN_ERR_BUS_OFF,
    ByteStream,
    CanConnector,
    Delay,
    SerialConnector,
    Trouble,
    TroubledAdapter,
    lost_line,
    unwritable_line,
)
from norton_sim.world import World

Inbox = deque[tuple[int, can.Message]]


class SimulatedCanWire:
    """A CAN bus that carries frames with delay: each host that is open gets every frame of every device.

    ``switches_bitrate``: the data of its CAN FD frames go at a bit rate of their own.
    """

    def __init__(self, world: World, to_host: Delay, to_devices: Delay, *, switches_bitrate: bool = False) -> None:
        self._world = world
        self._switches_bitrate = switches_bitrate
        self._to_host_delay = to_host
        self._to_devices_delay = to_devices
        self._plugs: list[CanConnector] = []
        self._inboxes: list[Inbox] = []
        self._underway: deque[can.Message] = deque()  # to the devices; nothing overtakes
        self.troubled: TroubledAdapter | None = None

    def attach(self, plug: CanConnector) -> None:
        self._plugs.append(plug)

    def suffer(self, trouble: Trouble | None) -> None:
        """See :class:`norton_sim.connectors.HostEnd`."""
        if trouble is Trouble.BUS_OFF:
            self.report_error(CAN_ERR_BUS_OFF)
        self.troubled = None if trouble is None else TroubledAdapter(trouble)

    def report_error(self, error_class: int) -> None:
        arrival_ns = self._to_host_delay.arrival_ns(self._world.now_ns)
        self._hand_over(arrival_ns, can.Message(arrival_ns * 1e-9, error_class, is_error_frame=True, data=bytes(8)))

    def to_host(self, arbitration_id: int, data: bytes, extended: bool, fd: bool) -> None:
        arrival_ns = self._to_host_delay.arrival_ns(self._world.now_ns)
        if not self._inboxes or (self.troubled is not None and not self.troubled.hears):
            return
        message = can.Message(arrival_ns * 1e-9, arbitration_id, extended, data=data, is_fd=fd)
        message.bitrate_switch = fd and self._switches_bitrate
        self._hand_over(arrival_ns, message)

    def _hand_over(self, arrival_ns: int, message: can.Message) -> None:
        for inbox in self._inboxes:
            inbox.append((arrival_ns, message))

    def to_devices(self, message: can.Message) -> None:
        """Carry a host's frame to every device. Raises can.CanOperationError where the adapter refuses it."""
        if self.troubled is not None:
            self.troubled.send()
            return
        arrival_ns = self._to_devices_delay.arrival_ns(self._world.now_ns)
        self._underway.append(message)
        self._world.at(arrival_ns, self._deliver)

    def open(self) -> Inbox:
        """A new host on the bus: it hears what is sent from now on."""
        inbox: Inbox = deque()
        self._inboxes.append(inbox)
        return inbox

    def close(self, inbox: Inbox) -> None:
        # By identity: two hosts that have heard nothing yet are equal, and still not the same.
        self._inboxes = [other for other in self._inboxes if other is not inbox]

    def _deliver(self, _stamp_ns: int) -> None:
        message = self._underway.popleft()
        for plug in self._plugs:
            plug.deliver(message)


class SimulatedBus(can.BusABC):
    """The host's end of a simulated CAN bus. Time stamps of received frames are their arrival, to the nanosecond."""

    def __init__(self, name: str, world: World, wire: SimulatedCanWire, can_filters: CanFilters | None = None) -> None:
        self.channel_info = f"simulated {name}"
        self._world = world
        self._wire = wire
        self._inbox = wire.open()
        super().__init__(channel=name, can_filters=can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._wire.to_devices(msg)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """As python-can has it, but ``timeout`` is in simulated time, which passes while this waits.

        Overridden whole, as python-can's own measures its timeout on the machine's clock.
        """
        if self._wire.troubled is not None:
            self._wire.troubled.receive()
        inbox, now_ns = self._inbox, self._world.now_ns
        while inbox and inbox[0][0] <= now_ns:
            message = inbox.popleft()[1]
            if self._filters is None or self._matches_filters(message):
                return message
        return None if timeout == 0 else self._wait(timeout)

    def _wait(self, timeout: float | None) -> can.Message | None:
        world = self._world
        deadline_ns = None if timeout is None else world.now_ns + round(timeout * 1e9)
        while deadline_ns is None or world.now_ns < deadline_ns:
            world.advance(self._next_look_ns(deadline_ns))
            message = self.recv(0)
            if message is not None:
                return message
        return None

    def _next_look_ns(self, deadline_ns: int | None) -> int:
        """The next instant at which there may be something to read; at the latest the deadline."""
        instants = [self._world.next_event_ns, deadline_ns, self._inbox[0][0] if self._inbox else None]
        # A world in which nothing is planned and nothing was sent would keep a caller waiting for ever.
        return min((instant for instant in instants if instant is not None), default=self._world.now_ns + 1_000_000)

    def shutdown(self) -> None:
        if not self._is_shutdown:
            self._wire.close(self._inbox)
        super().shutdown()


class SimulatedSerialWire:
    """A serial line to one device; bytes that it sends while no host has it open are lost."""

    paced = True

    def __init__(self, world: World, to_host: Delay, to_device: Delay) -> None:
        self._world = world
        self._delay = to_host
        self._to_device_delay = to_device
        self._stream: ByteStream | None = None
        self._connector: SerialConnector | None = None
        self._underway: deque[bytes] = deque()  # to the device; nothing overtakes
        self._free_ns = 0  # when the last byte on its way to the device has arrived
        self._byte_ns = 0.0
        self.host_baud: int | None = None
        self.unplugged = False

    def attach(self, plug: SerialConnector) -> None:
        self._connector = plug

    def suffer(self, trouble: Trouble | None) -> None:
        """See :class:`norton_sim.connectors.HostEnd`; a line that is not unplugged is well."""
        self.unplugged = trouble is Trouble.UNPLUGGED

    def report_error(self, error_class: int) -> None:
        """Serial adapters do not tell."""

    def to_host(self, data: bytes, begun_ns: int | None = None) -> None:
        if self._stream is not None:
            self._stream.send(self._world.now_ns if begun_ns is None else begun_ns, data)

    def open(self, baud: int) -> ByteStream:
        """A host opens the line, with an empty input buffer."""
        self._stream = ByteStream(baud, self._delay)
        self.host_baud = baud
        self._byte_ns = BITS_PER_BYTE * 1e9 / baud
        return self._stream

    def to_device(self, data: bytes) -> None:
        """Carry what the host wrote: it acts when its last byte is there."""
        start_ns = max(self._free_ns, self._to_device_delay.arrival_ns(self._world.now_ns))
        self._free_ns = start_ns + round(len(data) * self._byte_ns)
        self._underway.append(data)
        self._world.at(self._free_ns, self._deliver)

    def close(self) -> None:
        self._stream = None

    def _deliver(self, _stamp_ns: int) -> None:
        data = self._underway.popleft()
        if self._connector is not None:
            self._connector.deliver(data)


class SimulatedLine:
    """The host's end of a simulated serial line, never blocking."""

    def __init__(self, world: World, wire: SimulatedSerialWire, baud: int) -> None:
        self._world = world
        self._wire = wire
        self._stream = wire.open(baud)

    @property
    def in_waiting(self) -> int:
        if self._wire.unplugged:
            raise lost_line()
        return self._stream.waiting(self._world.now_ns)

    def read(self, size: int = 1) -> bytes:
        return self._stream.take(size, self._world.now_ns)

    def write(self, data: bytes, /) -> int:
        if self._wire.unplugged:
            raise unwritable_line()
        self._wire.to_device(data)
        return len(data)

    def arrival_ns(self) -> int:
        """When the last byte read had arrived."""
        return self._stream.last_arrival_ns

    def close(self) -> None:
        self._wire.close()
