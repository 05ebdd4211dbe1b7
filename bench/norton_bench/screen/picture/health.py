"""Whether devices, buses and the loop are well, from what they send and from what is told of them."""

from collections import deque
from dataclasses import dataclass
from math import nan

import numpy as np

from norton_bench.records import Event, Measured, Table
from norton_bench.report.streams import LEAST_PAUSE_NS
from norton_bench.rig.rig import Rig
from norton_drivers.wiring import DeviceSettings

RATE_OVER_NS = 2_000_000_000
TROUBLE_FOR_NS = 5_000_000_000
# By role: the table of its readings, and what a tick says of their age and of the drive's temperature.
STREAMS = {
    "actuator": ("motion", "motion_age_ns", "transistor_temperature_c"),
    "load": ("load_motion", "load_motion_age_ns", "load_transistor_temperature_c"),
    "torque_sensor": ("torque", "torque_age_ns", None),
    "modulator": ("modulator_motion", "modulator_motion_age_ns", "modulator_transistor_temperature_c"),
}
TROUBLES = ("bus", "device")


@dataclass(frozen=True)
class Pulse:
    """One device or bus as it is now. ``state`` is "ok", "silent", "trouble" or "unheard"; NaN is not known."""

    name: str
    kind: str
    place: str
    state: str
    rate_hz: float = nan
    age_ms: float = nan
    lost: int = 0
    temperature_c: float = nan
    said: str = ""  # the last trouble


class Stream:
    """The readings of one device: how many a second, how many lost."""

    def __init__(self) -> None:
        self.lost = 0
        self._counts: deque[tuple[int, int]] = deque()
        self._last: tuple[int, int] | None = None  # arrival and sequence number

    def take(self, table: Table, now_ns: int) -> None:
        if len(table):
            arrivals, numbers = table["arrival_ns"], table["sequence"]
            if self._last is not None:
                arrivals, numbers = np.append(self._last[0], arrivals), np.append(self._last[1], numbers)
            # Between procedures nothing is recorded, and nothing lost.
            running = np.diff(arrivals) < LEAST_PAUSE_NS
            self.lost += int(np.maximum(np.diff(numbers)[running] - 1, 0).sum())
            self._last = int(arrivals[-1]), int(numbers[-1])
        self._counts.append((now_ns, len(table)))
        while self._counts and self._counts[0][0] < now_ns - RATE_OVER_NS:
            self._counts.popleft()

    @property
    def rate_hz(self) -> float:
        """NaN until there is a stretch to count in."""
        if len(self._counts) < 2:
            return nan
        span_ns = self._counts[-1][0] - self._counts[0][0]
        return 1e9 * sum(count for _, count in list(self._counts)[1:]) / span_ns if span_ns > 0 else nan


class Health:
    """All devices and buses of a rig."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._streams = {device.role: Stream() for device in rig.wiring.devices()}
        self._last: Table | None = None
        self._troubles: dict[str, Event] = {}
        self._now_ns = 0

    def take(self, part: Measured) -> None:
        for event in part.events:
            if event.kind in TROUBLES:
                self._troubles[event.text.partition(":")[0].strip("[]")] = event
        if not len(part.ticks):
            return
        self._last, self._now_ns = part.ticks[-1:].copy(), int(part.ticks["tick_ns"][-1])
        for role, stream in self._streams.items():
            stream.take(getattr(part, STREAMS[role][0]), self._now_ns)

    def devices(self) -> list[Pulse]:
        """One for each device, in the order of the rig file."""
        return [self._device(device) for device in self._rig.wiring.devices()]

    def buses(self) -> list[Pulse]:
        """One for each bus."""
        return [
            self._troubled(Pulse(bus.name, bus.interface, bus.channel, self._state_of_bus(bus.name)), f"bus {bus.name}")
            for bus in self._rig.wiring.buses
        ]

    def _device(self, device: DeviceSettings) -> Pulse:
        _, age_name, temperature_name = STREAMS[device.role]
        place = device.bus or device.port or ""
        name = device.role.replace("_", " ")
        if self._last is None:
            return Pulse(name, device.driver, place, "unheard")
        age_ns = int(self._last[age_name][0])
        silent = age_ns > self._rig.limits.stale_after_ns
        stream = self._streams[device.role]
        pulse = Pulse(
            name,
            device.driver,
            place,
            "silent" if silent else "ok",
            stream.rate_hz,
            age_ns * 1e-6 if age_ns >= 0 else nan,
            stream.lost,
            nan if temperature_name is None else float(self._last[temperature_name][0]),
        )
        return self._troubled(pulse, device.role)

    def _troubled(self, pulse: Pulse, key: str) -> Pulse:
        event = self._troubles.get(key)
        if event is None:
            return pulse
        fresh = self._now_ns - event.stamp_ns < TROUBLE_FOR_NS and pulse.state == "ok"
        said = event.text.partition(": ")[2]
        return Pulse(**{**pulse.__dict__, "state": "trouble" if fresh else pulse.state, "said": said})

    def _state_of_bus(self, name: str) -> str:
        """A bus is as well as what is on it."""
        states = {self._device(device).state for device in self._rig.wiring.devices() if device.bus == name}
        return next((state for state in ("silent", "unheard") if state in states), "ok")
