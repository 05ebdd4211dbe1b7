"""The loop: a tick is one straight line (:meth:`Loop.tick`), and however it ends, the drives are idle then."""

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from norton_bench.control.admittance import AdmittanceController
from norton_bench.errors import BenchError, OperatorStopError
from norton_bench.guard.check import NOTHING, Commands, DriveHealth
from norton_bench.guard.guard import Guard
from norton_bench.loop.bench_loop import Learned
from norton_bench.loop.devices import Devices, WatchdogFinding
from norton_bench.loop.outbox import Outlet
from norton_bench.loop.segment_run import SegmentRun, Step
from norton_bench.loop.stop_word import never_stop
from norton_bench.loop.together import RunningSegment, run_together, running_together
from norton_bench.loop.troubles import TroubleLog
from norton_bench.records import NO_SEGMENT, Measured, SegmentInfo, Tick
from norton_bench.sample import Alignment, Sample
from norton_bench.segments import Segment, Use
from norton_drivers.errors import DeviceError
from norton_drivers.readings import DeviceIdentity, DriveState, DriveStatus

# How long the drives stay enabled, under the guard, while the session is late. It computes for up to 0.5 s between two
# segments on a core of its own; where nine other processes want that core, ten times as long.
HELD_S = 5.0
AT_REST = Segment("wait", "rest", Use.PREPARE, np.zeros(1))
NOT_THERE = DriveStatus(DriveState.UNKNOWN)
Drives = tuple[DriveHealth, ...]


class Stages(NamedTuple):
    """When a tick was due and when it began, and when each of its stages was done."""

    deadline_ns: int
    begun_ns: int
    received_ns: int
    controlled_ns: int
    guarded_ns: int
    sent_ns: int


@dataclass
class Loop:
    """Runs segments on enabled devices.

    ``stop_request`` is called every tick; it returns the operator's reason to stop, or None. ``controller`` is needed
    for segments in admittance mode; in the others it observes, so that it can take over without a bump. ``on_time`` is
    entered while the drives are enabled.
    """

    devices: Devices
    guard: Guard
    outbox: Outlet
    alignment: Alignment
    tick_ns: int
    stop_request: Callable[[], str | None] = never_stop
    controller: AdmittanceController | None = None
    on_time: Callable[[], AbstractContextManager[None]] = nullcontext
    command_may_be_a_place: bool = False
    skipped_ticks: int = field(default=0, init=False)
    _next_ns: int = field(default=0, init=False)
    _segments: int = field(default=0, init=False)
    _label: int = field(default=NO_SEGMENT, init=False)  # which of them the ticks belong to
    _last: SegmentRun | None = field(default=None, init=False)  # since the drives were enabled
    _reference_rad: float | None = field(default=None, init=False)  # where the last reference ended
    _sample: Sample = field(default=Sample(0), init=False)  # of the last tick
    _sent: Commands = field(default=NOTHING, init=False)  # by the last tick
    _put_ns: int = field(default=0, init=False)  # what it took to put the last tick away

    def __post_init__(self) -> None:
        self._clock = self.devices.clock
        self._troubles = TroubleLog(self.devices, self.outbox.put_event)

    def running(self) -> AbstractContextManager[None]:
        """Drives enabled inside, idle outside, whatever happens in between.

        Raises DeviceError, ExperimentError, and SafetyStopError where the guard has tripped and was not reset.
        """
        return running_together((self,))

    def identify(self) -> list[DeviceIdentity]:
        """The identity of every device, as it states it. Raises DeviceError."""
        return self.devices.identify()

    def verify_watchdogs(self) -> tuple[WatchdogFinding, ...]:
        """Test every drive's watchdog, and record the results. Nothing moves.

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
        """Use these results from now on. Call it with the drives idle: a new controller takes a second or two.

        Raises ExperimentError where no controller can be made for this load.
        """
        self.guard.learn(learned.guard)
        calibration, bias_nm = learned.calibration, learned.torque_bias_nm
        if bias_nm is not None:
            self.alignment.torque_bias_nm = bias_nm
        if calibration is not None and (self.controller is None or self.controller.calibration != calibration):
            self.controller = AdmittanceController(calibration, self.tick_ns * 1e-9, self.guard.limits.load_torque_nm)

    def reset_guard(self, word: str) -> None:
        """Allow the drives to be enabled again after a trip; the operator's ``word`` is recorded with its reason.

        Raises UsageError where ``word`` is empty.
        """
        reason = self.guard.tripped
        self.guard.reset(word)
        self.outbox.put_event(self.devices.clock.now_ns(), "operator", f"reset the guard ({word}) after: {reason}")

    def listen(self) -> None:
        """Wait for the first reading of every stream. Raises ExperimentError with the names of those that do not
        come."""
        arrivals = self.devices.await_streams()
        now_ns = self._clock.now_ns()
        self.alignment.update(now_ns, now_ns, arrivals)

    def tell_idle(self) -> None:
        """Tell every drive to idle; what fails is an event."""
        self._complain(self.devices.tell_idle())

    def await_idle(self) -> None:
        """Wait until every drive is idle; what fails is an event."""
        self._complain(self.devices.await_idle())
        self._troubles.end(self._clock.now_ns())

    def _complain(self, complaints: Iterable[str]) -> None:
        for complaint in complaints:
            self.outbox.put_event(self._clock.now_ns(), "drive", complaint)

    def start(self, now_ns: int) -> None:
        """The first tick is due a tick from now; nothing has been commanded."""
        self._sample, self._sent = self.alignment.update(now_ns, now_ns, self.devices.receive()), NOTHING
        self.guard.begin(self._sample)
        self._troubles.begin(now_ns)
        self._last, self._reference_rad = None, None
        if self.controller is not None:
            self.controller.rest()
        self._next_ns = now_ns + self.tick_ns

    def run(self, segment: Segment) -> Measured:
        """Run one segment; returns what was measured in it.

        Raises SafetyStopError, OperatorStopError, ConnectionFailedError; :meth:`running` then idles the drives.
        """
        return run_together((self,), (segment,))[0]

    def begin(self, segment: Segment) -> RunningSegment:
        """The segment, ready for its first tick."""
        self._last = run = self._prepared(segment)
        self._label = self._segments
        return RunningSegment(self, run, self._next_ns)

    def end(self, segment: RunningSegment) -> None:
        """No further tick of it, whatever the reason."""
        self._ended(segment.run)
        self._segments += 1

    def info(self, segment: RunningSegment) -> SegmentInfo:
        """What the recording says of it so far."""
        return SegmentInfo.of(segment.run.segment, self._segments, segment.start_ns, self._next_ns)

    def hold(self, ordered: Callable[[], bool]) -> None:
        """Go on as the last segment ended, guarded, until there is an order; these ticks belong to no segment.

        The actuator's command stays for as long as the loop itself might stand still, and is zero from then on. After a
        segment that ended because the shaft had become fast enough, what pushes it is zero at once; a command that may
        be a place, to which the shaft would jump, stays.

        Raises as :meth:`run` does, and SafetyStopError where no order comes within :data:`HELD_S`.
        """
        run, self._label = self._prepared(self._going_on()), NO_SEGMENT
        while run.index < run.ticks:
            if ordered():
                self._ended(run)
                return
            if self.tick(run):
                self.outbox.hand_on()
        raise self.guard.trip(
            f"the session did not say within {HELD_S:g} s what comes after a segment: other programs keep it from "
            "the processor, or it has too much to compute there: end them, or decide with the drives idle",
            "stall",
        )

    def _going_on(self) -> Segment:
        """What the loop does after the last segment, until the next one is ordered."""
        last, ticks = self._last, round(HELD_S * 1e9 / self.tick_ns)
        if last is None:
            return AT_REST.continued(0, 0, 0, ticks, self.tick_ns * 1e-9)
        acting = self.guard.limits.stall_after_ns // self.tick_ns
        pushing = 0 if last.fast else acting
        kept = acting if self.command_may_be_a_place else pushing
        return last.segment.continued(max(last.index - 1, 0), kept, pushing, ticks, self.tick_ns * 1e-9)

    def _prepared(self, segment: Segment) -> SegmentRun:
        """Ready for its first tick, which is the next one that is not over yet."""
        base_rad, last = self._reference_rad, self._last
        if base_rad is None or last is None or not last.keeps_reference_for(segment):
            base_rad = self._sample.load_position_rad
        run = SegmentRun(segment, self.controller, base_rad)
        self._skip_missed(run, self._clock.now_ns())
        return run

    def _ended(self, run: SegmentRun) -> None:
        if run.index:
            self._reference_rad = run.end_rad

    def tick(self, run: SegmentRun) -> bool:
        """The next tick of ``run``, in the six lines of docs/loop.md; whether the outbox has a part to hand on."""
        devices, now_ns = self.devices, self._clock.now_ns
        self._clock.wait_until_ns(self._next_ns, self._read_ahead)

        begun_ns = now_ns()
        arrivals = devices.receive()
        received_ns = now_ns()
        if received_ns - self._next_ns >= self.tick_ns:
            run.skip(self._skip_missed(run, received_ns))

        deadline_ns = self._next_ns
        sample = self._sample = self.alignment.update(received_ns, deadline_ns, arrivals)

        step = run.steps.at(run.index)
        wish = Commands(step.command, run.load_torque_nm(sample, step), 0, step.modulation)
        controlled_ns = now_ns()

        if (reason := self.stop_request()) is not None:
            raise OperatorStopError(f"stopped by the operator: {reason}")
        drives = devices.health()
        allowed = self.guard.limit(wish, sample, drives)
        guarded_ns = now_ns()

        sent = self._sent = devices.send(allowed)
        sent_ns = now_ns()

        run.sent(sent.load_torque_nm)
        run.index += 1
        run.fast = abs(sample.velocity_rad_s) >= run.segment.stop_at_velocity_rad_s
        self._next_ns = deadline_ns + self.tick_ns
        stages = Stages(deadline_ns, max(begun_ns, deadline_ns), received_ns, controlled_ns, guarded_ns, sent_ns)
        full = self.outbox.put(self._row(stages, sample, step, wish, sent, drives), arrivals)
        self._put_ns = now_ns() - sent_ns
        if begun_ns >= self._troubles.due_ns:
            self._troubles.look(begun_ns)
        return full

    @property
    def next_tick_ns(self) -> int:
        """When the next tick is due."""
        return self._next_ns

    def skip_to(self, run: SegmentRun, due_ns: int) -> None:
        """Miss all ticks before ``due_ns``, because another loop has. Raises SafetyStopError."""
        if missed := self._skip_missed(run, due_ns):
            run.skip(missed)

    def _read_ahead(self) -> None:
        """While the tick waits: what has come by then need not be read when time is short."""
        self.devices.link.read_ahead()
        self.outbox.put_waiting()

    def _skip_missed(self, run: SegmentRun, now_ns: int) -> int:
        """Go on with the tick that is not over yet; returns how many were missed. Raises SafetyStopError.

        Ticks whose whole period is over are skipped, never made up for; the last command acted meanwhile.
        """
        missed = max((now_ns - self._next_ns) // self.tick_ns, 0)
        if not missed:
            return 0
        stall_ns = missed * self.tick_ns
        self.skipped_ticks += missed
        self._next_ns += stall_ns
        self.guard.stood_still(self._next_ns, stall_ns)
        for _ in range(missed):
            run.sent(self._sent.load_torque_nm)
        if stall_ns > self.guard.limits.stall_after_ns:
            raise self.guard.trip(
                f"the loop stood still for {stall_ns / 1e6:.0f} ms, more than stall_after = "
                f"{self.guard.limits.stall_after_ns / 1e6:g} ms: other programs kept it from the processor, or a "
                "virtual machine's host did; end them, or give the loop its rights (`rig check` names them)",
                "stall",
            )
        return missed

    def _row(self, at: Stages, sample: Sample, step: Step, wish: Commands, sent: Commands, drives: Drives) -> Tick:
        devices, actuator = self.devices, drives[0].status
        load = NOT_THERE if devices.load is None else drives[1].status
        modulator = NOT_THERE if devices.modulator is None else drives[-1].status
        return {
            "tick_ns": at.deadline_ns,
            "lateness_ns": at.begun_ns - at.deadline_ns,
            "work_ns": at.sent_ns - at.begun_ns,
            "segment": self._label,
            "command": sent.command,
            "wished_load_torque_nm": wish.load_torque_nm,
            "load_torque_nm": sent.load_torque_nm,
            "torque_nm": sample.torque_nm,
            "torque_age_ns": sample.torque_age_ns,
            "position_rad": sample.position_rad,
            "velocity_rad_s": sample.velocity_rad_s,
            "motion_age_ns": sample.motion_age_ns,
            "load_position_rad": sample.load_position_rad,
            "load_velocity_rad_s": sample.load_velocity_rad_s,
            "load_motion_age_ns": sample.load_motion_age_ns,
            "reference_position_rad": step.target.position_rad,
            "reference_velocity_rad_s": step.target.velocity_rad_s,
            "transistor_temperature_c": actuator.transistor_temperature_c,
            "load_transistor_temperature_c": load.transistor_temperature_c,
            "limited": sent.limited,
            "receive_ns": max(at.received_ns - at.begun_ns, 0),
            "control_ns": at.controlled_ns - at.received_ns,
            "guard_ns": at.guarded_ns - at.controlled_ns,
            "send_ns": at.sent_ns - at.guarded_ns,
            "put_ns": self._put_ns,
            "modulation": sent.modulation,
            "modulator_position_rad": sample.modulator_position_rad,
            "modulator_motion_age_ns": sample.modulator_motion_age_ns,
            "modulator_transistor_temperature_c": modulator.transistor_temperature_c,
            "supply_v": actuator.bus_voltage_v,
            "load_supply_v": load.bus_voltage_v,
            "motor_temperature_c": actuator.motor_temperature_c,
            "load_motor_temperature_c": load.motor_temperature_c,
        }
