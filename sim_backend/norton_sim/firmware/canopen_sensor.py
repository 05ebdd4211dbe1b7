"""A torque sensor on CANopen, such as HBM's TIM40: its value only where it has changed, and a status.

Source: HBM TIM40 mounting instructions A02590, "PDO contents"; CiA 404 for the objects that hold the value. The value
goes where the rig says that it is. What triggers it can be set: change (255), SYNC, or its event timer.
"""

import struct
from math import isfinite

from norton_drivers.canopen.sensor import CanopenSensorOptions
from norton_drivers.codecs.canopen import mapping_word
from norton_drivers.codecs.canopen_torque import TorqueField
from norton_drivers.wiring import parse_options
from norton_sim.firmware.canopen.node import CanopenNode
from norton_sim.firmware.canopen.objects import I16, I32, U8, U16, U32, Entry
from norton_sim.firmware.site import Site, TorqueSignal

DEVICE_TYPE = 0x00020194  # a measuring device of profile 404
ERROR_NO_VALUE = 0x5000
_PADDING = 0x0005  # CiA 301's dummy object of one byte
_STATUS = 0x6150
# The process value, where CiA 404 has it for each type. A float is held as its bits.
_VALUES = {"i16": (0x7130, I16), "i32": (0x9130, I32), "f32": (0x6130, U32)}


class CanopenSensor:
    """Reports the port's torque, saturated where its digits end; ``status`` is sent where it changes.

    Where it has no value it sends none, and an emergency.
    """

    def __init__(self, site: Site) -> None:
        options = parse_options(CanopenSensorOptions, site.settings)
        self.signal = TorqueSignal(site.world.plant)
        self.node = CanopenNode(site, options.node, DEVICE_TYPE, "simulated torque sensor")
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
        site.cyclic(round(options.period_s * 1e9), self._measure)

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
