"""Every signal of a bench: the present value, its age, and the least and greatest value since the start."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.events import Note, PartMeasured, SessionEvent
from norton_bench.records import STREAMS, Measured, Table
from norton_bench.rig.rig import Rig


@dataclass(frozen=True)
class SignalValue:
    """One signal. NaN means unknown; ``age_s`` is NaN for a command, and for a reading without a time."""

    device: str
    name: str
    unit: str
    value: float = nan
    age_s: float = nan
    least: float = nan
    greatest: float = nan


@dataclass(frozen=True)
class SignalSource:
    """Where a signal comes from: the ticks, whose column ``age`` says how old it is, or the readings of ``stream``.

    An ``optional`` one need not be measured.
    """

    device: str
    name: str
    unit: str
    values: Callable[[Table], FloatArray]
    age: str = ""
    optional: bool = False
    stream: str = ""


class BenchSignals:
    """The signals of one rig; :meth:`take` gets the measurements, in order."""

    def __init__(self, rig: Rig) -> None:
        self._sources = tuple(_sources(rig))
        self._seen = {
            (each.device, each.name): SignalValue(each.device, each.name, each.unit) for each in self._sources
        }
        self._arrivals_ns: dict[str, int] = {}  # of the newest reading, by stream

    def take(self, part: Measured) -> None:
        """Update the signals with ``part``; takes a few microseconds for each."""
        if not len(part.ticks):
            return
        last, now_ns = part.ticks[-1], int(part.ticks["tick_ns"][-1])
        for each in self._sources:
            if each.stream:
                self._take_readings(each, part, now_ns)
            else:
                age_ns = int(last[each.age]) if each.age else -1
                self._update(each, each.values(part.ticks), age_ns * 1e-9 if age_ns >= 0 else nan)

    def seen(self) -> tuple[SignalValue, ...]:
        """All signals; optional ones only if they have been measured."""
        return tuple(
            self._seen[each.device, each.name]
            for each in self._sources
            if not each.optional or isfinite(self._seen[each.device, each.name].value)
        )

    def forget_extremes(self) -> None:
        """Restart the least and greatest values, at the present ones."""
        for key, seen in self._seen.items():
            self._seen[key] = SignalValue(
                seen.device, seen.name, seen.unit, seen.value, seen.age_s, seen.value, seen.value
            )

    def _take_readings(self, source: SignalSource, part: Measured, now_ns: int) -> None:
        table: Table = getattr(part, source.stream)
        if len(table):
            self._arrivals_ns[source.stream] = int(table["arrival_ns"][-1])
        values = source.values(table) if len(table) else np.array([self._seen[source.device, source.name].value])
        arrival_ns = self._arrivals_ns.get(source.stream)
        self._update(source, values, nan if arrival_ns is None else max(now_ns - arrival_ns, 0) * 1e-9)

    def _update(self, source: SignalSource, values: FloatArray, age_s: float) -> None:
        before = self._seen[source.device, source.name]
        self._seen[source.device, source.name] = SignalValue(
            source.device,
            source.name,
            source.unit,
            float(values[-1]),
            age_s,
            float(np.fmin(before.least, np.fmin.reduce(values))),
            float(np.fmax(before.greatest, np.fmax.reduce(values))),
        )


def _column(name: str) -> Callable[[Table], FloatArray]:
    return lambda table: table[name]


def _sources(rig: Rig) -> Iterator[SignalSource]:
    wiring = rig.wiring
    yield SignalSource("actuator", "command", rig.command.unit, _column("command"))
    yield from _machine("actuator", "")
    if wiring.load is not None:
        yield SignalSource("load", "torque command", "N*m", _column("load_torque_nm"))
        yield from _machine("load", "load_")
    if wiring.torque_sensor is not None:
        yield SignalSource("port", "torque", "N*m", _column("torque_nm"), "torque_age_ns")
        yield SignalSource(
            "port", "power", "W", lambda ticks: ticks["torque_nm"] * ticks["velocity_rad_s"], "torque_age_ns"
        )
    if rig.modulation is not None:
        yield SignalSource("modulator", "command", rig.modulation.unit, _column("modulation"))
        yield SignalSource("modulator", "angle", "rad", _column("modulator_position_rad"), "modulator_motion_age_ns")
        yield from _read("modulator")
        temperature = _column("modulator_transistor_temperature_c")
        yield SignalSource("modulator", "transistors", "°C", temperature, optional=True)
    for sensor in wiring.sensors:
        yield from _read(sensor.role)


def _machine(device: str, prefix: str) -> Iterator[SignalSource]:
    age = f"{prefix}motion_age_ns"
    yield SignalSource(device, "angle", "rad", _column(f"{prefix}position_rad"), age)
    yield SignalSource(device, "velocity", "rad/s", _column(f"{prefix}velocity_rad_s"), age)
    yield from _read(device)
    yield SignalSource(device, "supply", "V", _column(f"{prefix}supply_v"), optional=True)
    yield SignalSource(device, "transistors", "°C", _column(f"{prefix}transistor_temperature_c"), optional=True)
    yield SignalSource(device, "motor", "°C", _column(f"{prefix}motor_temperature_c"), optional=True)


def _read(role: str) -> Iterator[SignalSource]:
    """What the device measures and no tick repeats."""
    for stream in STREAMS:
        if stream.role == role and not stream.age:
            for each in stream.kind.quantities:
                device, values = role.replace("_", " "), _column(each.column)
                yield SignalSource(device, each.name, each.unit, values, optional=True, stream=stream.name)


class HeldSignals:
    """A watcher of a bench that is moved to given values: the signals while these were held.

    ``words`` are the names of the segments to watch, upward ramps included; notes are passed to ``say``.
    """

    def __init__(self, rig: Rig, words: str, say: Callable[[str], None]) -> None:
        self.words = words
        self.signals = BenchSignals(rig)
        self._say = say

    def __call__(self, event: SessionEvent) -> None:
        match event:
            case PartMeasured(measured) if measured.segments and measured.segments[-1].name == self.words:
                self.signals.take(measured)
            case Note(text):
                self._say(text)
