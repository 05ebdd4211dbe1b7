"""A torque sensor on CANopen that sends its value by itself (TPDO), as HBM's TIM40 does.

Many send only where the value has changed: no frame then says that nothing has happened, as long as the sensor's
heartbeat says that it lives. Torque is that which the actuator exerts on the load, times ``direction``.
"""

from math import inf
from typing import Literal

from pydantic import Field, field_validator

from norton_drivers.canopen.master import master_of
from norton_drivers.canopen.node import DEVICE_TYPE, Node, answers, load_dictionary, probes, recognise  # noqa: F401  (found here by whoever looks for them)
from norton_drivers.canopen.parameters import trigger_sent
from norton_drivers.codecs import canopen as protocol
from norton_drivers.codecs import canopen_torque, cia402
from norton_drivers.codecs.canopen import NmtState
from norton_drivers.codecs.canopen_torque import PDO_MAX, TorqueField, ValueType
from norton_drivers.errors import DeviceError, DeviceTimeoutError, WiringError
from norton_drivers.link import Link, wait_until
from norton_drivers.readings import DeviceIdentity, Inbox, TorqueReading
from norton_drivers.wiring import DeviceSettings, TorqueSensorOptions, parse_options

CONNECTION = "can"
OPTION_UNITS = {"scale": "N*m", "range": "N*m", "heartbeat": "s", "period": "s", "averaging": "s"}
OPTION_FILES = ("eds",)  # may stand beside the rig file

_STATUS_PDO = 2
# Between two frames further apart than this, values were left out.
_GAP_PERIODS = 1.5
# No frame for so long is no longer a late one. Below the least age at which a reading is stale.
_SILENCE_PERIODS = 3.0
_CATCH_UP_PERIODS = 100


class CanopenSensorOptions(TorqueSensorOptions):
    """What a rig file may say of a CANopen torque sensor."""

    node: int = Field(ge=1, le=protocol.NODE_MAX, description="the sensor's CANopen node id, 1 to 127", examples=[3])
    scale_nm: float = Field(alias="scale", description="torque of one digit of its value", examples=["1 mN*m"])
    heartbeat_s: float = Field(
        alias="heartbeat",
        ge=1e-3,
        le=10,
        description="the sensor's heartbeat period (1017h): three of them missed, and its readings end",
        examples=["10 ms"],
    )
    send: Literal["on change", "always", "sync", "timer"] = Field(
        "on change",
        description='when it sends: set up in the sensor ("on change", "always"), or by us ("sync", "timer")',
    )
    period_s: float = Field(
        1e-3, alias="period", ge=1e-3, le=0.1, description="of its values, and of SYNC or its timer", examples=["1 ms"]
    )
    pdo: int = Field(1, ge=1, le=4, description="which of its TPDOs carries the torque")
    cob_id: int | None = Field(
        None, ge=0x101, le=0x6FF, description="that TPDO's identifier; by default 0x180 + 0x100 (pdo - 1) + node"
    )
    type: ValueType = Field("i32", description="the value's type")
    offset: int = Field(0, ge=0, lt=PDO_MAX, description="bytes before the value")
    length: int | None = Field(None, ge=1, le=PDO_MAX, description="bytes of the TPDO; by default the value ends it")
    status_cob_id: int | None = Field(
        None, ge=0x101, le=0x6FF, description="identifier of its status; by default 0x280 + node"
    )
    status_mask: int = Field(
        0, ge=0, le=0xFFFFFFFF, description="bits of its status that forbid to trust the value; 0: it has no status"
    )
    range_nm: float = Field(inf, alias="range", gt=0, description="the torque it can measure", examples=["2 N*m"])
    master_node: int = Field(protocol.NODE_MAX, ge=1, le=protocol.NODE_MAX, description="our own node id on this bus")
    eds: str = Field("torque-sensor", description="the sensor's EDS file, or the name of a shipped one")

    @field_validator("scale_nm")
    @classmethod
    def _is_a_scale(cls, scale_nm: float) -> float:
        if scale_nm == 0:
            raise ValueError("must not be 0")
        return scale_nm

    @property
    def field(self) -> TorqueField:
        """Where the value stands in its PDO."""
        end = TorqueField(self.type, self.offset).end
        return TorqueField(self.type, self.offset, self.length or end)

    @property
    def torque_id(self) -> int:
        return self.cob_id or protocol.transmit_pdo_id(self.node, self.pdo)

    @property
    def status_id(self) -> int:
        return self.status_cob_id or protocol.transmit_pdo_id(self.node, _STATUS_PDO)


def check_settings(settings: DeviceSettings) -> None:
    """Raises WiringError for a value that does not fit into its PDO, and for an EDS file that cannot be read."""
    options = parse_options(CanopenSensorOptions, settings)
    _check_field(options, settings)
    load_dictionary(options.eds, options.node, settings.role)


def _check_field(options: CanopenSensorOptions, settings: DeviceSettings) -> None:
    field = options.field
    if not field.end <= field.length <= PDO_MAX:
        raise WiringError(
            f"[{settings.role}] an {field.kind} at offset = {field.offset} does not fit into length = {field.length} "
            "bytes; lower offset, or raise length to at most 8"
        )


def open_torque_sensor(settings: DeviceSettings, link: Link) -> "CanopenSensor":
    """Opens the sensor and lets it send. Raises WiringError, ConnectionFailedError, and DeviceError for the sensor."""
    options = parse_options(CanopenSensorOptions, settings)
    _check_field(options, settings)
    dictionary = load_dictionary(options.eds, options.node, settings.role)
    master = master_of(settings, link, options.master_node)
    if options.send == "sync":
        master.want_sync(options.period_s, settings.role)
    sensor = CanopenSensor(settings, options, Node(settings.role, options.node, dictionary, master, link), link)
    sensor.set_up()
    return sensor


class CanopenSensor:
    """A value that has not changed is a reading again each period, for as long as the heartbeat is fresh."""

    def __init__(self, settings: DeviceSettings, options: CanopenSensorOptions, node: Node, link: Link) -> None:
        self.role = settings.role
        self.node = node
        self._options = options
        self._link = link
        self._field = options.field
        self._scale_nm = settings.direction * options.scale_nm
        self._period_ns = round(options.period_s * 1e9)
        self._on_change = options.send == "on change"
        self._status: int | None = None
        self._torque_nm: float | None = None  # the last value
        self._stamp_ns = 0  # of the last reading
        self._message = -1  # the number of the last one
        self._readings: Inbox[TorqueReading] = Inbox()
        node.listen(options.torque_id, self._on_torque)
        if options.status_mask:
            node.listen(options.status_id, self._on_status)

    @property
    def range_nm(self) -> float:
        return self._options.range_nm

    def set_up(self) -> None:
        """See that it may be a sensor, let it send as the rig says, and start it. Raises DeviceError."""
        profile = self.node.parameters.number(DEVICE_TYPE) & 0xFFFF
        if profile == cia402.PROFILE:
            raise DeviceError(f"{self.node.place}: says that it is a drive (profile 402); is this the node id meant?")
        self.node.begin(self._options.heartbeat_s)
        self._torque_nm = self._status = None
        if self._options.send == "sync":
            trigger_sent(self.node.parameters, self._options.pdo, 1)
        elif self._options.send == "timer":
            timer_ms = round(self._options.period_s * 1e3)
            trigger_sent(self.node.parameters, self._options.pdo, protocol.EVENT_DRIVEN, timer_ms)
        self.node.start()

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Ask who it is, and see that its value, and its status where it has one, have come."""
        if self.node.restarted:
            self.set_up()
        identity = self.node.identity("canopen")
        if not wait_until(lambda: self._torque_nm is not None, self._link, timeout_s):
            raise DeviceTimeoutError(
                f"{self.node.place}: sends no value of {self._field.length} bytes (identifier "
                f"0x{self._options.torque_id:03X}) in {timeout_s:g} s ({self.node.malformed} malformed frames); switch "
                "that TPDO on in the sensor, check pdo, cob_id, type, offset and length, and turn the shaft a little"
            )
        if self._options.status_mask and not wait_until(lambda: self._status is not None, self._link, timeout_s):
            raise DeviceTimeoutError(
                f"{self.node.place}: sends no status (identifier 0x{self._options.status_id:03X}) in {timeout_s:g} s; "
                "switch that TPDO on in the sensor, or leave out status_mask"
            )
        return identity

    def take_torque(self) -> list[TorqueReading]:
        if self._on_change:
            self._say_again(self._link.clock.now_ns(), round(_SILENCE_PERIODS * self._period_ns))
        return self._readings.take()

    def _say_again(self, until_ns: int, patience_ns: int) -> None:
        """What is not sent has not changed, while the sensor lives: a reading for each value that it left out.

        Each bears the time at which its frame would have come, so that readings stay as regular as the sensor is, and
        the number of the message that it repeats: a frame that is merely late comes yet.
        """
        if self._torque_nm is None or until_ns - self._stamp_ns < patience_ns or not self._lives(until_ns):
            return
        if until_ns - self._stamp_ns > _CATCH_UP_PERIODS * self._period_ns:
            self._stamp_ns = until_ns - patience_ns  # nobody was here to take them
        while until_ns - self._stamp_ns >= patience_ns:
            self._put(self._torque_nm, self._stamp_ns + self._period_ns)

    def _lives(self, now_ns: int) -> bool:
        heartbeat_ns = self.node.heartbeat_ns
        if heartbeat_ns is None or not self.node.operational:
            return False
        return now_ns - heartbeat_ns <= self.node.heartbeat_timeout_ns

    def _put(self, torque_nm: float, stamp_ns: int) -> None:
        self._stamp_ns = stamp_ns
        self._readings.put(TorqueReading(self._message, stamp_ns, torque_nm, None, self._is_trusted()))

    def _is_trusted(self) -> bool:
        if self.node.emergencies:
            return False
        mask = self._options.status_mask
        return not mask or (self._status is not None and not self._status & mask)

    def _on_torque(self, data: bytearray, arrival_ns: int) -> None:
        torque_nm = self._scale_nm * self._field.decode(data)
        if self.node.state is NmtState.BOOT_UP:
            return  # it restarted, and nobody knows what it sends
        if self._on_change:
            self._say_again(arrival_ns, round(_GAP_PERIODS * self._period_ns))
        self._torque_nm = torque_nm
        self._message += 1
        self._put(torque_nm, arrival_ns)

    def _on_status(self, data: bytearray, arrival_ns: int) -> None:
        self._status = canopen_torque.status_of(data)
