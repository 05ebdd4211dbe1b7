"""Torque sensors on CAN."""

import struct
from math import isfinite
from typing import Any

from cantools.database.can.signal import Signal

from norton_drivers.canopen.sensor import CanopenSensorOptions
from norton_drivers.codecs.canopen import mapping_word
from norton_drivers.codecs.canopen_torque import TorqueField
from norton_drivers.dbc_sensor import DbcOptions, load_message
from norton_drivers.wiring import parse_options
from norton_sim.firmware.canopen.node import CanopenNode
from norton_sim.firmware.canopen.objects import I16, I32, U8, U16, U32, Entry
from norton_sim.firmware.context import DeviceContext, TorqueSignal

DBC_PERIOD_NS = 1_000_000


class DbcSensor:
    """A torque sensor on CAN that sends the message a DBC file describes, at 1 kHz.

    Sends torque, counter and status in the signals that the rig names; every other signal is zero.
    """

    def __init__(self, context: DeviceContext) -> None:
        options = parse_options(DbcOptions, context.settings)
        self.signal = TorqueSignal(context.world.plant)
        self.status = 0
        self._options = options
        self._scale = 1.0 if options.scale is None else options.scale
        self._message = load_message(options, context.settings.role)
        self._values: dict[str, Any] = dict.fromkeys((signal.name for signal in self._message.signals), 0)
        self._least, self._most = _range_of(self._message.get_signal_by_name(options.signal))
        self._count_span = 0
        if options.counter is not None:
            self._count_span = 1 << self._message.get_signal_by_name(options.counter).length
        self._connector = context.can_connector()
        context.cyclic(DBC_PERIOD_NS, self._send)

    def freeze(self) -> None:
        """From now on report the torque of this instant; the counter runs on."""
        self.signal.freeze()

    def _send(self, _stamp_ns: int) -> None:
        self._measure()
        if self._options.counter is not None:
            self._values[self._options.counter] = (self._values[self._options.counter] + 1) % self._count_span
        data = self._message.encode(self._values, strict=False)
        self._connector.send(self._message.frame_id, data, extended=self._message.is_extended_frame)

    def _measure(self) -> None:
        value = self.signal.measure_nm() / self._scale
        good = isfinite(value)
        # A number in a frame saturates, and cannot be NaN as a float may: that is what the status is for.
        self._values[self._options.signal] = min(max(value, self._least), self._most) if good else self._most
        if self._options.status is not None:
            self._values[self._options.status] = self.status if good else max(1, self.status)


def _range_of(signal: Signal) -> tuple[float, float]:
    """The least and the greatest value that a signal's bits can say."""
    if signal.is_float:
        return -3.4e38, 3.4e38
    span = 1 << signal.length
    first = -span // 2 if signal.is_signed else 0
    ends = [signal.scale * raw + signal.offset for raw in (first, first + span - 1)]
    return min(ends), max(ends)


DEVICE_TYPE = 0x00020194  # a measuring device of profile 404
ERROR_NO_VALUE = 0x5000
_PADDING = 0x0005  # CiA 301's dummy object of one byte
_STATUS = 0x6150
# The process value, where CiA 404 has it for each type. A float is held as its bits.
_VALUES = {"i16": (0x7130, I16), "i32": (0x9130, I32), "f32": (0x6130, U32)}


class CanopenSensor:
    """A torque sensor on CANopen, such as HBM's TIM40: its value only where it has changed, and a status.

    Source: HBM TIM40 mounting instructions A02590, "PDO contents"; CiA 404 for the objects that hold the value. The
    value goes where the rig says that it is. What triggers it can be set: change (255), SYNC, or its event timer.

    Reports the port's torque, saturated where its digits end; ``status`` is sent where it changes.

    Where it has no value it sends none, and an emergency.
    """

    def __init__(self, context: DeviceContext) -> None:
        options = parse_options(CanopenSensorOptions, context.settings)
        self.signal = TorqueSignal(context.world.plant)
        self.node = CanopenNode(context, options.node, DEVICE_TYPE, "simulated torque sensor")
        self._options = options
        self._broken = False
        index, layout = _VALUES[options.type]
        self._value = self.node.objects.add(index, 1, Entry(layout, mappable=True))
        self._status = self.node.objects.add(_STATUS, 1, Entry(U16, mappable=True))
        self.node.objects.add(_PADDING, 0, Entry(U8, mappable=True))
        mapped = _mapping(options.field, mapping_word(index, 1, self._value.bits))
        self._value_pdo = self.node.add_sent(options.pdo, mapped, options.torque_id)
        self._status_pdo = self.node.add_sent(
            2 if options.pdo != 2 else 3, (mapping_word(_STATUS, 1, 16),), options.status_id
        )
        context.cyclic(round(options.period_s * 1e9), self._measure)

    @property
    def status(self) -> int:
        return self._status.value

    @status.setter
    def status(self, status: int) -> None:
        self._status.value = status
        self._status_pdo.event()

    def freeze(self) -> None:
        """From now on report the torque of this instant: nothing changes, so nothing is sent."""
        self.signal.freeze()

    def _measure(self, _stamp_ns: int) -> None:
        torque_nm = self.signal.measure_nm()
        if isfinite(torque_nm) is self._broken:
            self._broken = not self._broken
            self.node.emergency(ERROR_NO_VALUE if self._broken else 0)
        if self._broken:
            return
        changed = self._digits(torque_nm) != self._value.value
        self._value.value = self._digits(torque_nm)
        if self._options.send == "always" or (self._options.send == "on change" and changed):
            self._value_pdo.event()

    def _digits(self, torque_nm: float) -> int:
        digits = torque_nm / self._options.scale_nm
        if self._options.type == "f32":
            return int.from_bytes(struct.pack("<f", digits), "little")
        most = (1 << self._value.bits - 1) - 1
        return min(max(round(digits), -most), most)


def _mapping(field: TorqueField, value: int) -> tuple[int, ...]:
    padding = mapping_word(_PADDING, 0, 8)
    return (*[padding] * field.offset, value, *[padding] * (field.length - field.end))
