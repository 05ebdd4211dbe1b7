"""The loop: one tick is one straight line, and leaving it, however that happens, leaves the drives idle."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from math import nan

from bench.control.admittance import AdmittanceController
from bench.errors import BenchError, OperatorStopError
from bench.guard.commands import Commands, DriveHealth
from bench.guard.guard import Guard
from bench.loop.alignment import Alignment
from bench.loop.devices import Arrivals, Devices
from bench.loop.load_strategy import LoadStrategy, strategy_for
from bench.loop.outbox import Outbox
from bench.loop.troubles import TroubleLog
from bench.records import Measured, SegmentInfo, join
from bench.sample import Sample, Target
from bench.segments import LoadMode, Segment
from drivers.errors import DeviceError


def never_stop() -> str | None:
    """No operator is there to stop anything."""
    return None


@dataclass
class Loop:
    """Runs segments on enabled devices.

    ``stop_request`` is asked every tick and returns the operator's reason to stop, or None. ``controller`` is needed
    for segments in admittance mode, and watches all others so that it takes over without a bump. ``on_time`` is entered
    while the loop runs.
    """

    devices: Devices
    guard: Guard
    outbox: Outbox
    alignment: Alignment
    tick_ns: int
    stop_request: Callable[[], str | None] = never_stop
    controller: AdmittanceController | None = None
    on_time: Callable[[], AbstractContextManager[None]] = nullcontext
    skipped_ticks: int = field(default=0, init=False)
    _next_ns: int = field(default=0, init=False)
    _segments: int = field(default=0, init=False)
    _reference_rad: float | None = field(default=None, init=False)  # where the last imposed motion ended
    _begun: bool = field(default=False, init=False)  # whether the segment has had a tick
    _position_rad: float = field(default=nan, init=False)
    _load_torque_nm: float = field(default=0.0, init=False)  # the last one sent

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

    def reset_guard(self, word: str) -> None:
        """Let the drives be enabled again after a trip, on an operator's ``word``, which is put away with the reason.

        Raises UsageError where nothing was said.
        """
        reason = self.guard.tripped
        self.guard.reset(word)
        self.outbox.put_event(self.devices.clock.now_ns(), "operator", f"reset the guard ({word}) after: {reason}")

    def _enabled(self) -> Iterator[None]:
        begun = self.devices.await_streams()
        self._sample(self.devices.clock.now_ns(), begun)
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
        base_rad = self._position_rad if self._reference_rad is None else self._reference_rad
        strategy = strategy_for(segment, self.controller, base_rad)
        self._pass_missed(strategy)
        commands, stop_at_rad_s = segment.command.astype(float).tolist(), segment.stop_at_velocity_rad_s
        start_ns, index, done = self._next_ns, 0, False
        self._begun = False
        parts: list[Measured] = []
        try:
            while index < len(commands) and not done:
                self._clock.wait_until_ns(self._next_ns)
                begun_ns, arrivals = self._clock.now_ns(), self.devices.receive()
                index = min(index + self._obey_time(strategy), len(commands) - 1)
                sample, full = self._tick(commands[index], strategy, index, begun_ns, arrivals)
                done = abs(sample.velocity_rad_s) >= stop_at_rad_s
                index += 1
                self._troubles.look(begun_ns)
                if full:
                    parts.append(self.outbox.hand_on(self._info(segment, start_ns)).without_frames())
        finally:
            parts.append(self.outbox.hand_on(self._info(segment, start_ns)).without_frames())
            self._segments += 1
        rigid = segment.mode is LoadMode.ADMITTANCE and segment.admittance.rigid
        self._reference_rad = strategy.target(segment.ticks - 1).position_rad if rigid else None
        return join(parts)

    def _start(self) -> None:
        now_ns = self.devices.clock.now_ns()
        sample = self._sample(now_ns, self.devices.receive())
        self.guard.begin(sample)
        self._troubles.begin(now_ns)
        self._position_rad, self._reference_rad, self._load_torque_nm = sample.load_position_rad, None, 0.0
        self._next_ns = now_ns + self.tick_ns

    def _tick(
        self, command: float, strategy: LoadStrategy, index: int, begun_ns: int, arrivals: Arrivals
    ) -> tuple[Sample, bool]:
        deadline_ns, now_ns = self._next_ns, self._clock.now_ns()
        sample = self._sample(now_ns, arrivals)
        # The controller steps from deadline to deadline.
        seen = sample if now_ns == deadline_ns else sample.counted_from(deadline_ns)
        if not self._begun:
            strategy.begin(seen)
            self._begun = True
        wish = Commands(command, strategy.wish(seen, index))
        self._obey_operator()
        drives = self.devices.health()
        commands = self.devices.send(self.guard.limit(wish, sample, drives))
        strategy.note_sent(commands.load_torque_nm)
        self._load_torque_nm = commands.load_torque_nm
        self._position_rad = sample.load_position_rad
        self._next_ns = deadline_ns + self.tick_ns
        row = self._row(deadline_ns, max(begun_ns, deadline_ns), sample, wish, commands, strategy.target(index), drives)
        return sample, self.outbox.put(row, arrivals)

    def _sample(self, now_ns: int, arrivals: Arrivals) -> Sample:
        return self.alignment.update(
            now_ns, arrivals.motion, arrivals.load_motion, arrivals.torque, arrivals.current, arrivals.load_current
        )

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
                f"{self.guard.limits.stall_after_ns / 1e6:g} ms",
                "stall",
            )
        return missed

    def _pass_missed(self, strategy: LoadStrategy) -> int:
        """Ticks whose whole period has passed are skipped, never made up for; the last command acted meanwhile."""
        missed = max((self._clock.now_ns() - self._next_ns) // self.tick_ns, 0)
        self.skipped_ticks += missed
        self._next_ns += missed * self.tick_ns
        for _ in range(missed):
            strategy.note_sent(self._load_torque_nm)
        return missed

    def _info(self, segment: Segment, start_ns: int) -> SegmentInfo:
        return SegmentInfo(
            self._segments,
            segment.procedure,
            segment.name,
            segment.use,
            segment.mode.value,
            start_ns,
            self._next_ns,
            segment.preview,
        )

    def _row(
        self,
        deadline_ns: int,
        begun_ns: int,
        sample: Sample,
        wish: Commands,
        commands: Commands,
        target: Target,
        drives: tuple[DriveHealth, ...],
    ) -> tuple[float, ...]:
        return (
            deadline_ns,
            begun_ns - deadline_ns,
            self._clock.now_ns() - begun_ns,
            self._segments,
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
            drives[0].status.transistor_temperature_c,
            drives[1].status.transistor_temperature_c if len(drives) > 1 else nan,
            commands.limited,
        )
