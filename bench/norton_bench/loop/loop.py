"""The loop: one tick is one straight line, and leaving it, however that happens, leaves the drives idle."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from math import nan
from typing import NamedTuple

import numpy as np

from norton_bench.control.admittance import AdmittanceController
from norton_bench.errors import BenchError, OperatorStopError
from norton_bench.guard.check import Commands, DriveHealth
from norton_bench.guard.guard import Guard
from norton_bench.loop.devices import Arrivals, Devices
from norton_bench.loop.learned import Learned
from norton_bench.loop.load_strategy import LoadStrategy, strategy_for
from norton_bench.loop.outbox import Outlet
from norton_bench.loop.segment_info import segment_info
from norton_bench.loop.troubles import TroubleLog
from norton_bench.loop.unrolled import Unrolled
from norton_bench.loop.watchdogs import WatchdogFinding
from norton_bench.records import NO_SEGMENT, Measured, SegmentInfo, join
from norton_bench.sample import Alignment, Sample, Target
from norton_bench.segments import LoadMode, Segment, Use
from norton_drivers.errors import DeviceError
from norton_drivers.readings import DeviceIdentity, DriveState, DriveStatus

# How long drives stay enabled, the bench guarded, for a session that is late. What it computes between two segments
# takes up to 0.5 s on a core of its own; where nine others want that core too, ten times as long.
HELD_S = 5.0
AT_REST = Segment("wait", "rest", Use.PREPARE, np.zeros(1))
NOT_THERE = DriveStatus(DriveState.UNKNOWN)


def never_stop() -> str | None:
    """No operator is there to stop anything."""
    return None


class Stages(NamedTuple):
    """When a tick began, and when each of its stages was done."""

    begun_ns: int
    received_ns: int
    controlled_ns: int
    guarded_ns: int
    sent_ns: int


@dataclass
class Loop:
    """Runs segments on enabled devices.

    ``stop_request`` is asked every tick and returns the operator's reason to stop, or None. ``controller`` is needed
    for segments in admittance mode, and watches all others so that it takes over without a bump. ``on_time`` is entered
    while the loop runs.
    """

    devices: Devices
    guard: Guard
    outbox: Outlet
    alignment: Alignment
    tick_ns: int
    stop_request: Callable[[], str | None] = never_stop
    controller: AdmittanceController | None = None
    on_time: Callable[[], AbstractContextManager[None]] = nullcontext
    skipped_ticks: int = field(default=0, init=False)
    _next_ns: int = field(default=0, init=False)
    _segments: int = field(default=0, init=False)
    _label: int = field(default=NO_SEGMENT, init=False)  # which of them the ticks belong to
    _last_segment: Segment = field(default=AT_REST, init=False)
    _last_index: int = field(default=0, init=False)  # the tick of it that was the last
    _too_fast: bool = field(default=False, init=False)  # it ended at the speed at which it was to end
    _reference_rad: float | None = field(default=None, init=False)  # where the last imposed motion ended
    _begun: bool = field(default=False, init=False)  # whether the segment has had a tick
    _position_rad: float = field(default=nan, init=False)
    _load_torque_nm: float = field(default=0.0, init=False)  # the last one sent
    _put_ns: int = field(default=0, init=False)  # what it took to put the last tick away

    def __post_init__(self) -> None:
        self._clock = self.devices.clock
        self._troubles = TroubleLog(self.devices, self.outbox.put_event)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Drives enabled inside, idle outside, whatever happens in between.

        Raises DeviceError, ExperimentError, and SafetyStopError where the guard has tripped and was not reset.
        """
        self.guard.permit()
        with self.on_time():
            yield from self._enabled()

    def identify(self) -> list[DeviceIdentity]:
        """Who everybody says to be. Raises DeviceError."""
        return self.devices.identify()

    def verify_watchdogs(self) -> tuple[WatchdogFinding, ...]:
        """See every drive's watchdog act; what is found is put away too. Nothing moves.

        Raises SafetyStopError where one does not, DeviceError where a drive cannot be enabled.
        """
        try:
            with self.on_time():  # it is about time
                found = self.devices.verify_watchdogs()
            for finding in found:
                self.outbox.put_event(self._clock.now_ns(), "watchdog", str(finding))
        except (BenchError, DeviceError) as error:
            self.outbox.put_event(self._clock.now_ns(), "stop", str(error))
            raise
        finally:
            self.outbox.hand_on()
        return found

    def learn(self, learned: Learned) -> None:
        """Know what the session knows. Call it with the drives idle: a new controller takes a second or two.

        Raises ExperimentError where no controller can be made for this load.
        """
        self.guard.learn(learned.guard)
        calibration, bias_nm = learned.calibration, learned.torque_bias_nm
        if bias_nm is not None:
            self.alignment.torque_bias_nm = bias_nm
        if calibration is not None and (self.controller is None or self.controller.calibration != calibration):
            self.controller = AdmittanceController(calibration, self.tick_ns * 1e-9, self.guard.limits.load_torque_nm)

    def reset_guard(self, word: str) -> None:
        """Let the drives be enabled again after a trip, on an operator's ``word``, which is put away with the reason.

        Raises UsageError where nothing was said.
        """
        reason = self.guard.tripped
        self.guard.reset(word)
        self.outbox.put_event(self.devices.clock.now_ns(), "operator", f"reset the guard ({word}) after: {reason}")

    def _enabled(self) -> Iterator[None]:
        begun = self.devices.await_streams()
        now_ns = self._clock.now_ns()
        self.alignment.update(now_ns, now_ns, begun)
        self.devices.enable()
        try:
            self._start()
            yield
        except (BenchError, DeviceError) as error:
            self.outbox.put_event(self.devices.clock.now_ns(), "stop", str(error))
            raise
        finally:
            for complaint in self.devices.stop():
                self.outbox.put_event(self.devices.clock.now_ns(), "drive", complaint)
            self._troubles.end(self.devices.clock.now_ns())
            self.outbox.hand_on()

    def run(self, segment: Segment) -> Measured:
        """Run one segment; returns what was measured in it.

        Raises SafetyStopError, OperatorStopError, ConnectionFailedError; :meth:`running` then idles the drives.
        """
        strategy = self._strategy(segment)
        start_ns, self._label, self._last_segment = self._next_ns, self._segments, segment
        parts: list[Measured] = []

        def hand_on() -> None:
            parts.append(self.outbox.hand_on(self._info(segment, start_ns)).without_frames())

        try:
            self._too_fast = self._go_through(segment, strategy, hand_on)
        finally:
            hand_on()
            self._segments += 1
        return join(parts)

    def hold(self, ordered: Callable[[], bool]) -> None:
        """Go on as the last segment ended, guarded, until there is an order; these ticks belong to no segment.

        The actuator's command stays for as long as the loop itself might stand still, and is zero from then on; it is
        zero at once after a segment that ended because the shaft had become fast enough.

        Raises as :meth:`run` does, and SafetyStopError where no order comes within :data:`HELD_S`.
        """
        held = round(HELD_S * 1e9 / self.tick_ns)
        kept = 0 if self._too_fast else self.guard.limits.stall_after_ns // self.tick_ns
        segment = self._last_segment.continued(self._last_index, kept, held, self.tick_ns * 1e-9)
        self._label = NO_SEGMENT
        if not self._go_through(segment, self._strategy(segment), self.outbox.hand_on, ordered):
            raise self.guard.trip(
                f"the session did not say within {HELD_S:g} s what comes after a segment: other programs keep it from "
                "the processor, or it has too much to compute there: end them, or decide with the drives idle",
                "stall",
            )

    def _strategy(self, segment: Segment) -> LoadStrategy:
        base_rad = self._position_rad if self._reference_rad is None else self._reference_rad
        strategy = strategy_for(segment, self.controller, base_rad)
        self._obey_time(strategy)
        return strategy

    def _go_through(
        self,
        segment: Segment,
        strategy: LoadStrategy,
        hand_on: Callable[[], object],
        ended: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Its ticks, one after the other; whether it ended before the last of them. Every full part is handed on."""
        commands, stop_at_rad_s = Unrolled(segment.command), segment.stop_at_velocity_rad_s
        modulations = Unrolled(segment.modulation) if len(segment.modulation) else Unrolled(np.zeros(len(commands)))
        index, done = 0, False
        self._begun = False
        while index < len(commands) and not (done := done or ended()):
            # What has come by then need not be read when time is short.
            self._clock.wait_until_ns(self._next_ns, self._read_ahead)
            begun_ns, arrivals = self._clock.now_ns(), self.devices.receive()
            index = min(index + self._obey_time(strategy), len(commands) - 1)
            sample, full = self._tick(commands[index], modulations[index], strategy, index, begun_ns, arrivals)
            done = abs(sample.velocity_rad_s) >= stop_at_rad_s
            index += 1
            self._troubles.look(begun_ns)
            if full:
                hand_on()
        if segment is self._last_segment:
            self._last_index = max(index - 1, 0)
        rigid = segment.mode is LoadMode.ADMITTANCE and segment.admittance.rigid
        if index:
            self._reference_rad = strategy.target(index - 1).position_rad if rigid else None
        return done

    def _read_ahead(self) -> None:
        self.devices.link.poll()
        self.outbox.put_waiting()

    def _start(self) -> None:
        now_ns = self.devices.clock.now_ns()
        sample = self.alignment.update(now_ns, now_ns, self.devices.receive())
        self.guard.begin(sample)
        self._troubles.begin(now_ns)
        self._position_rad, self._reference_rad, self._load_torque_nm = sample.load_position_rad, None, 0.0
        self._last_segment, self._last_index, self._too_fast = AT_REST, 0, False
        self._next_ns = now_ns + self.tick_ns

    def _tick(
        self,
        command: float,
        modulation: float,
        strategy: LoadStrategy,
        index: int,
        begun_ns: int,
        arrivals: Arrivals,
    ) -> tuple[Sample, bool]:
        clock, deadline_ns = self._clock, self._next_ns
        now_ns = clock.now_ns()
        sample = self.alignment.update(now_ns, deadline_ns, arrivals)
        if not self._begun:
            strategy.begin(sample)
            self._begun = True
        wish = Commands(command, strategy.wish(sample, index), 0, modulation)
        controlled_ns = clock.now_ns()
        self._obey_operator()
        drives = self.devices.health()
        allowed = self.guard.limit(wish, sample, drives)
        guarded_ns = clock.now_ns()
        commands = self.devices.send(allowed)
        stages = Stages(max(begun_ns, deadline_ns), now_ns, controlled_ns, guarded_ns, clock.now_ns())
        strategy.note_sent(commands.load_torque_nm)
        self._load_torque_nm = commands.load_torque_nm
        self._position_rad = sample.load_position_rad
        self._next_ns = deadline_ns + self.tick_ns
        row = self._row(deadline_ns, stages, sample, wish, commands, strategy.target(index), drives)
        full = self.outbox.put(row, arrivals)
        self._put_ns = clock.now_ns() - stages.sent_ns
        return sample, full

    def _obey_operator(self) -> None:
        reason = self.stop_request()
        if reason is not None:
            raise OperatorStopError(f"stopped by the operator: {reason}")

    def _obey_time(self, strategy: LoadStrategy) -> int:
        """Go on with the tick that is not over yet; returns how many were missed. Raises SafetyStopError."""
        missed = self._pass_missed(strategy)
        stall_ns = missed * self.tick_ns
        if stall_ns > self.guard.limits.stall_after_ns:
            raise self.guard.trip(
                f"the loop stood still for {stall_ns / 1e6:.0f} ms, more than stall_after = "
                f"{self.guard.limits.stall_after_ns / 1e6:g} ms: other programs kept it from the processor, or a "
                "virtual machine's host did; end them, or give the loop its rights (`rig check` names them)",
                "stall",
            )
        return missed

    def _pass_missed(self, strategy: LoadStrategy) -> int:
        """Ticks whose whole period has passed are skipped, never made up for; the last command acted meanwhile."""
        missed = max((self._clock.now_ns() - self._next_ns) // self.tick_ns, 0)
        self.skipped_ticks += missed
        self._next_ns += missed * self.tick_ns
        if missed:
            self.guard.stood_still(self._next_ns, missed * self.tick_ns)
        for _ in range(missed):
            strategy.note_sent(self._load_torque_nm)
        return missed

    def _info(self, segment: Segment, start_ns: int) -> SegmentInfo:
        return segment_info(segment, self._segments, start_ns, self._next_ns)

    def _row(
        self,
        deadline_ns: int,
        stages: Stages,
        sample: Sample,
        wish: Commands,
        commands: Commands,
        target: Target,
        drives: tuple[DriveHealth, ...],
    ) -> tuple[float, ...]:
        devices, actuator = self.devices, drives[0].status
        load = NOT_THERE if devices.load is None else drives[1].status
        return (
            deadline_ns,
            stages.begun_ns - deadline_ns,
            stages.sent_ns - stages.begun_ns,
            self._label,
            commands.command,
            wish.load_torque_nm,
            commands.load_torque_nm,
            sample.torque_nm,
            sample.torque_age_ns,
            sample.position_rad,
            sample.velocity_rad_s,
            sample.motion_age_ns,
            sample.load_position_rad,
            sample.load_velocity_rad_s,
            sample.load_motion_age_ns,
            target.position_rad,
            target.velocity_rad_s,
            actuator.transistor_temperature_c,
            load.transistor_temperature_c,
            commands.limited,
            max(stages.received_ns - stages.begun_ns, 0),
            stages.controlled_ns - stages.received_ns,
            stages.guarded_ns - stages.controlled_ns,
            stages.sent_ns - stages.guarded_ns,
            self._put_ns,
            commands.modulation,
            sample.modulator_position_rad,
            sample.modulator_motion_age_ns,
            nan if devices.modulator is None else drives[-1].status.transistor_temperature_c,
            actuator.bus_voltage_v,
            load.bus_voltage_v,
            actuator.motor_temperature_c,
            load.motor_temperature_c,
        )
