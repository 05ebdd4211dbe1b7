"""A torque sensor on CAN that sends the message a DBC file describes, at 1 kHz."""

from math import isfinite
from typing import Any

from cantools.database.can.signal import Signal

from norton_drivers.dbc_sensor import DbcOptions, load_message
from norton_drivers.wiring import parse_options
from norton_sim.firmware.site import Site, TorqueSignal

SAMPLE_PERIOD_NS = 1_000_000


class DbcSensor:
    """Sends torque, counter and status in the signals that the rig names; every other signal is zero."""

    def __init__(self, site: Site) -> None:
        options = parse_options(DbcOptions, site.settings)
        self.signal = TorqueSignal(site.world.plant)
        self.status = 0
        self._options = options
        self._scale = 1.0 if options.scale is None else options.scale
        self._message = load_message(options, site.settings.role)
        self._values: dict[str, Any] = dict.fromkeys((signal.name for signal in self._message.signals), 0)
        self._least, self._most = _range_of(self._message.get_signal_by_name(options.signal))
        self._count_span = 0
        if options.counter is not None:
            self._count_span = 1 << self._message.get_signal_by_name(options.counter).length
        self._plug = site.can_connector()
        site.cyclic(SAMPLE_PERIOD_NS, self._send)

    def freeze(self) -> None:
        """From now on report the torque of this instant; the counter runs on."""
        self.signal.freeze()

    def _send(self, _stamp_ns: int) -> None:
        self._measure()
        if self._options.counter is not None:
            self._values[self._options.counter] = (self._values[self._options.counter] + 1) % self._count_span
        data = self._message.encode(self._values, strict=False)
        self._plug.send(self._message.frame_id, data, extended=self._message.is_extended_frame)

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
