"""The parts of the state: estimates of parameters, progress of the session, tabulated readings, and health."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import isfinite, nan
from typing import NamedTuple

import numpy as np

from norton_bench.events import PlannedStep
from norton_bench.identification.results import LiveEstimate
from norton_bench.models.parameters import Estimate, Status
from norton_bench.records import STREAMS, Event, Measured, SegmentInfo, Table
from norton_bench.report.streams import LEAST_PAUSE_NS
from norton_bench.rig.rig import Rig
from norton_bench.segments import HOLD, READ, TABULATE_IMPEDANCE, TABULATE_SOURCE
from norton_drivers.wiring import DeviceSettings

WIDTH_95 = 1.96
# Enough for any sparkline; thinned by half whenever there are twice as many.
KEPT = 64


def half_width(estimate: Estimate) -> float:
    """Half of the 95 % interval over the value; NaN where either is missing."""
    if not (isfinite(estimate.value) and isfinite(estimate.std)) or estimate.value == 0 or estimate.std <= 0:
        return float("nan")
    return WIDTH_95 * estimate.std / abs(estimate.value)


@dataclass
class EstimateHistory:
    """The newest estimates, and for each parameter its relative half-widths so far, oldest first.

    ``final`` once they are those of the final fit.
    """

    estimates: tuple[Estimate, ...] = ()
    widths: dict[str, list[float]] = field(default_factory=dict)
    final: bool = False
    _stamp_ns: int = -1
    _every: int = 1
    _count: int = 0

    @property
    def valid(self) -> int:
        return sum(estimate.status is Status.VALID for estimate in self.estimates)

    def take(self, live: LiveEstimate) -> None:
        """Take the newest estimates; one that has not changed is ignored."""
        if self.final or live.stamp_ns <= self._stamp_ns or not live.estimates:
            return
        self._stamp_ns = live.stamp_ns
        changed, self.estimates = live.estimates != self.estimates, live.estimates
        if not changed:
            return
        self._count += 1
        if self._count % self._every == 0:
            self._remember()

    def settle(self, estimates: tuple[Estimate, ...]) -> None:
        """Take the estimates of the final fit; without any, the live ones stay."""
        if estimates:
            self.estimates, self.final = estimates, True
            self._remember()

    def network(self) -> dict[str, float] | None:
        """The values by name once all are valid, for the curve of the source; else None."""
        if not self.estimates or self.valid < len(self.estimates):
            return None
        return {estimate.name: estimate.value for estimate in self.estimates}

    def _remember(self) -> None:
        for estimate in self.estimates:
            self.widths.setdefault(estimate.name, []).append(half_width(estimate))
        if max(map(len, self.widths.values())) > 2 * KEPT:
            self.widths = {name: widths[1::2] for name, widths in self.widths.items()}
            self._every *= 2


@dataclass(frozen=True)
class StepState:
    """One step and its progress. ``share`` is 0 before it, 1 after it; ``took_s`` is bench time."""

    planned: PlannedStep
    state: str = "ahead"  # "ahead", "running", "done", "left out", "stopped"
    took_s: float = 0.0

    @property
    def share(self) -> float:
        """The finished share; below 1 while it runs, because durations are estimates."""
        if self.state != "running":
            return 1.0 if self.state == "done" else 0.0
        return min(self.took_s / self.planned.duration_s, 0.99) if self.planned.duration_s > 0 else 0.0

    @property
    def left_s(self) -> float:
        """Bench time that it may still take."""
        if self.state == "ahead":
            return self.planned.duration_s
        return max(self.planned.duration_s - self.took_s, 0.0) if self.state == "running" else 0.0


class StepList:
    """All steps, in order."""

    def __init__(self) -> None:
        self.all: tuple[StepState, ...] = ()
        self._begun_s = 0.0

    def plan(self, steps: Sequence[PlannedStep]) -> None:
        """Take a plan; steps that are known already stay as they are."""
        self.all = tuple(
            replace(self.all[index], planned=step) if index < len(self.all) else StepState(step)
            for index, step in enumerate(steps)
        )

    @property
    def running(self) -> StepState | None:
        return next((step for step in self.all if step.state == "running"), None)

    @property
    def number(self) -> int:
        """The number of the step that runs or ran last, from 1; 0 before the first."""
        return max((number for number, step in enumerate(self.all, 1) if step.state != "ahead"), default=0)

    @property
    def left_s(self) -> float:
        """Bench time that all of it may still take."""
        return sum(step.left_s for step in self.all)

    def begin(self, index: int, now_s: float) -> None:
        """Step ``index`` begins; those before it are over, or were left out."""
        self.end(now_s)
        self._begun_s = now_s
        states = list(self.all)
        for number, step in enumerate(states):
            if number < index and step.state == "ahead":
                states[number] = replace(step, state="left out")
            elif number == index:
                states[number] = replace(step, state="running", took_s=0.0)
        self.all = tuple(states)

    def advance(self, now_s: float) -> None:
        """The bench's time is ``now_s``."""
        self._running_becomes("running", now_s)

    def end(self, now_s: float, *, whole: bool = True) -> None:
        """The running step is over, or was ``stopped``."""
        self._running_becomes("done" if whole else "stopped", now_s)

    def _running_becomes(self, state: str, now_s: float) -> None:
        self.all = tuple(
            replace(step, state=state, took_s=now_s - self._begun_s) if step.state == "running" else step
            for step in self.all
        )


SOURCE, EXTERNAL, HELD = "source", "external", "held"


class Reading(NamedTuple):
    """A reading for the tables of source and impedance: the position of the port, and its torque there.

    ``what``: the source at the actuator's port, or at the external one, or the port held away from the source.

    ``rising``: whether command or position was approached from below.
    """

    what: str
    rising: bool
    command: float
    position_rad: float
    torque_nm: float


@dataclass
class Tabulated:
    """``readings`` in the order in which they were made, by segment; the last one may still change."""

    readings: dict[int, Reading] = field(default_factory=dict)

    @property
    def sources(self) -> list[Reading]:
        """The readings of the port whose source was read last."""
        sources = [each for each in self.readings.values() if each.what != HELD]
        return [each for each in sources if each.what == sources[-1].what]

    def take(self, part: Measured) -> None:
        """Update the readings with the newest ticks."""
        for segment in part.segments:
            what = _what(segment)
            rows = part.ticks[part.ticks["segment"] == segment.index] if what else part.ticks[:0]
            if not len(rows):
                continue
            command, position_rad, torque_nm = (
                float(np.mean(rows[column])) for column in ("command", "position_rad", "torque_nm")
            )
            self.readings[segment.index] = Reading(
                what, self._rising(segment, what, command), command, position_rad, torque_nm
            )

    def _rising(self, segment: SegmentInfo, what: str, command: float) -> bool:
        if what == HELD:
            return segment.name.endswith("rising")
        before = [each.command for index, each in self.readings.items() if index < segment.index]
        return command >= before[-1] if before else command >= 0.0


def _what(segment: SegmentInfo) -> str:
    """Empty where nothing is read."""
    if segment.procedure == TABULATE_IMPEDANCE:
        if segment.name.startswith(HOLD):
            return HELD
        return SOURCE if segment.name == READ else ""
    if segment.procedure == TABULATE_SOURCE and segment.name.startswith(READ):
        return EXTERNAL if segment.name.endswith(EXTERNAL) else SOURCE
    return ""


RATE_OVER_NS = 2_000_000_000
TROUBLE_FOR_NS = 5_000_000_000
# What a tick says of a drive's temperature, by its role.
TEMPERATURES = {
    "actuator": "transistor_temperature_c",
    "load": "load_transistor_temperature_c",
    "modulator": "modulator_transistor_temperature_c",
}
# A device whose readings no tick repeats may be slow: probes send one to ten readings a second.
SLOW_NS = 3_000_000_000
TROUBLES = ("bus", "device")


@dataclass(frozen=True)
class DeviceState:
    """The state of one device or bus: "ok", "silent", "trouble" or "unheard"; NaN means unknown."""

    name: str
    kind: str
    place: str
    state: str
    rate_hz: float = nan
    age_ms: float = nan
    lost: int = 0
    temperature_c: float = nan
    said: str = ""  # the last trouble


class DeviceStream:
    """The readings of one device: their rate, and how many were lost."""

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

    def age_ns(self, now_ns: int) -> int:
        """Of the newest reading; -1 before there is one."""
        return -1 if self._last is None else now_ns - self._last[0]

    @property
    def rate_hz(self) -> float:
        """The rate; NaN until there are enough readings."""
        if len(self._counts) < 2:
            return nan
        span_ns = self._counts[-1][0] - self._counts[0][0]
        return 1e9 * sum(count for _, count in list(self._counts)[1:]) / span_ns if span_ns > 0 else nan


class BenchHealth:
    """All devices and buses of a rig."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._streams = {device.role: DeviceStream() for device in rig.wiring.devices()}
        self._main = {each.role: each for each in reversed(STREAMS)}  # the first stream of each device
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
            stream.take(getattr(part, self._main[role].name), self._now_ns)

    def devices(self) -> list[DeviceState]:
        """One for each device, in the order of the rig file."""
        return [self._device(device) for device in self._rig.wiring.devices()]

    def buses(self) -> list[DeviceState]:
        """One for each bus."""
        return [
            self._troubled(
                DeviceState(bus.name, bus.interface, bus.channel, self._state_of_bus(bus.name)), f"bus {bus.name}"
            )
            for bus in self._rig.wiring.buses
        ]

    def _device(self, device: DeviceSettings) -> DeviceState:
        place = device.bus or device.port or ""
        name = device.role.replace("_", " ")
        if self._last is None:
            return DeviceState(name, device.driver, place, "unheard")
        stream, temperature = self._streams[device.role], TEMPERATURES.get(device.role)
        age_ns, most_ns = stream.age_ns(self._now_ns), SLOW_NS
        if self._main[device.role].age:
            age_ns, most_ns = int(self._last[self._main[device.role].age][0]), self._rig.limits.stale_after_ns
        pulse = DeviceState(
            name,
            device.driver,
            place,
            "silent" if age_ns > most_ns else "ok",
            stream.rate_hz,
            age_ns * 1e-6 if age_ns >= 0 else nan,
            stream.lost,
            nan if temperature is None else float(self._last[temperature][0]),
        )
        return self._troubled(pulse, device.role)

    def _troubled(self, pulse: DeviceState, key: str) -> DeviceState:
        event = self._troubles.get(key)
        if event is None:
            return pulse
        fresh = self._now_ns - event.stamp_ns < TROUBLE_FOR_NS and pulse.state == "ok"
        said = event.text.partition(": ")[2]
        return DeviceState(**{**pulse.__dict__, "state": "trouble" if fresh else pulse.state, "said": said})

    def _state_of_bus(self, name: str) -> str:
        """The state of a bus is the worst of those of its devices."""
        states = {self._device(device).state for device in self._rig.wiring.devices() if device.bus == name}
        return next((state for state in ("silent", "unheard") if state in states), "ok")
