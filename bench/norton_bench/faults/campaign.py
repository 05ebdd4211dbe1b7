"""Runs many fault cases on several rigs: in lock step with as many processes as jobs, then in wall time one by one."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from typing import Any

from norton_bench.faults.case import Case, CaseResult, Expected
from norton_bench.faults.host_loss import lose_host
from norton_bench.faults.rehearse import Exercise, allowed_on, prepare, rehearse
from norton_bench.rig.rig import Rig
from norton_bench.session.pool import process_pool

RIDE = Expected.RIDE
DRIVES = ("actuator", "load")  # those that turn the shaft
SENSOR = "torque_sensor"
MODULATOR = "modulator"


# Which faults are tried on a rig: each kind, wherever it has a place there, in sizes that its limits give.
def cases(rig: Rig) -> tuple[Case, ...]:
    """All of them; the rig has a load drive and a torque sensor."""
    return tuple(
        case for part in (_carried(rig), _connected(rig), _read(rig), _driven(rig), _host(rig)) for case in part
    )


def host_losses() -> tuple[Case, ...]:
    """Those that need wall time, and processes that can be killed."""
    return (
        Case("host killed (SIGKILL), wall time", {"kind": "host-killed"}, quick=True),
        Case("host stopped (SIGSTOP), wall time", {"kind": "host-stopped"}),
    )


def _carried(rig: Rig) -> Iterator[Case]:
    for role in _devices(rig):
        # What comes from a device is its own; what goes to it is all that the host sends on its bus.
        yield _case("one frame lost", "drop", role, RIDE, count=1, towards="host", quick=role == "actuator")
        yield _case("frames doubled", "duplicate", role, RIDE, count=20, towards="host")
        if _bus_of(rig, role):
            yield _case("frames out of order", "reorder", role, RIDE, count=20, towards="host")
    for role in DRIVES:
        yield _case("commands lost", "drop", role, RIDE, count=20, towards="device")
        yield _case("commands doubled", "duplicate", role, RIDE, count=20, towards="device")
    for bus in _buses(rig):
        yield _case("a tenth of all frames lost", "drop", bus, RIDE, share="10 %", lasts="300 ms")
        yield _case("frames corrupted, check fails", "corrupt", bus, RIDE, crc="caught", count=50, quick=True)
        yield _case("frames late by 3 ms", "delay", bus, RIDE, by="3 ms", lasts="100 ms")
        yield _case("frames late by 200 ms", "delay", bus, by="200 ms")
    for role in DRIVES:
        if _bus_of(rig, role):
            yield _case("a frame corrupted, check passes", "corrupt", role, RIDE, crc="missed", towards="host", count=1)
    if _bus_of(rig, SENSOR) is None:
        yield _case("messages corrupted", "corrupt", SENSOR, RIDE, bits=3, count=3, quick=True)
        yield _case("every message corrupted", "corrupt", SENSOR, bits=3)


def _connected(rig: Rig) -> Iterator[Case]:
    for bus in _buses(rig):
        yield _case("a node babbles, 30 % of the bus", "babbling-node", bus, RIDE, load="30 %", lasts="300 ms")
        yield _case("a node babbles, 70 % of the bus", "babbling-node", bus, RIDE, load="70 %", lasts="300 ms")
        yield _case("a node babbles, all of the bus", "babbling-node", bus, quick=True)
        yield _case("bus-off of the host", "bus-off", bus, quick=True)
        yield _case("adapter unplugged", "unplugged", bus)
    for role in _devices(rig):
        if _bus_of(rig, role):
            yield _case("bus-off of the device", "bus-off", role)
        else:
            yield _case("adapter unplugged", "unplugged", role)
        yield _case("silent for a while", "dropout", role, RIDE, lasts=f"{rig.limits.stale_after_ns / 2e6:g} ms")
        yield _case("silent", "dropout", role)


def _read(rig: Rig) -> Iterator[Case]:
    limit_nm = rig.limits.torque_nm
    for role in (*DRIVES, SENSOR):
        yield _case("reading frozen", "freeze", role)
        yield _case("sign flips", "sign-flip", role, quick=role == SENSOR)
    yield _case("saturates", "saturation", SENSOR, limit=f"{0.02 * limit_nm:g} N*m")
    yield _case("bias jumps", "bias-jump", SENSOR, by=f"{0.5 * limit_nm:g} N*m")
    yield _case("reads beyond the limit", "false-reading", SENSOR, torque=f"{1.2 * limit_nm:g} N*m", quick=True)
    yield _case("reads no number", "false-reading", SENSOR, torque="nan")
    for role in DRIVES:
        yield _case("encoder jumps", "encoder-jump", role, by="60 deg")


def _driven(rig: Rig) -> Iterator[Case]:
    for role in _devices(rig):
        if role != SENSOR:
            yield _case("drive error", "drive-error", role, quick=role == "actuator")
            yield _case("undervoltage", "undervoltage", role)
            yield _case("over-temperature", "over-temperature", role)
    for role in DRIVES:
        runaway = f"{0.4 * rig.limits.torque_nm:g} N*m"
        yield _case("command runs away", "runaway", role, torque=runaway, quick=role == "actuator")
        yield _case("shaft stuck", "stuck", role, quick=role == "load")
    if rig.wiring.modulator is not None:
        yield _case("does not go where it is sent", "stuck", MODULATOR)
    yield Case("coupling breaks", {"kind": "broken-coupling"})


def _host(rig: Rig) -> Iterator[Case]:
    stall_ms = rig.limits.stall_after_ns / 1e6
    yield Case("host stalls for a moment", {"kind": "host-stall", "for": f"{0.3 * stall_ms:g} ms"}, RIDE, quick=True)
    yield Case("host stalls", {"kind": "host-stall", "for": f"{1.5 * stall_ms:g} ms"}, quick=True)
    yield Case("host stalls for long", {"kind": "host-stall", "for": "2 s"})


def _case(
    name: str,
    kind: str,
    on: str,
    expected: Expected = Expected.STOP,
    *,
    lasts: str | None = None,
    quick: bool = False,
    **options: Any,
) -> Case:
    for_a_while = {} if lasts is None else {"for": lasts}
    return Case(name, {"kind": kind, "on": on, **options, **for_a_while}, expected, quick)


def _devices(rig: Rig) -> tuple[str, ...]:
    return (*DRIVES, SENSOR) if rig.wiring.modulator is None else (*DRIVES, SENSOR, MODULATOR)


def _buses(rig: Rig) -> list[str]:
    return [bus.name for bus in rig.wiring.buses]


def _bus_of(rig: Rig, role: str) -> str | None:
    return next((device.bus for device in rig.wiring.devices() if device.role == role), None)


OnOutcome = Callable[[CaseResult], None]


@dataclass(frozen=True)
class FaultTrial:
    """What to try on one rig: ``cases`` in lock step, ``losses`` of the host in wall time."""

    rig: Rig
    cases: Sequence[Case]
    losses: Sequence[Case] = ()

    @property
    def count(self) -> int:
        return len(self.cases) + len(self.losses)


def run_campaign(trials: Sequence[FaultTrial], jobs: int, seed: int | None, on_outcome: OnOutcome) -> list[CaseResult]:
    """All outcomes, rig by rig in the order of its cases; ``on_outcome`` hears of each as it comes.

    Raises RigError for a rig without a load drive; BenchError, DeviceError where one does not get as far as its faults.
    """
    for trial in trials:
        Exercise().require(trial.rig)
    by_rig = _in_lock_step(trials, jobs, seed, on_outcome)
    for trial, outcomes in zip(trials, by_rig, strict=True):
        if not trial.losses:
            continue
        allowed = allowed_on(trial.rig)
        # One by one, and nothing beside them: they are about time.
        for case in trial.losses:
            outcomes.append(lose_host(trial.rig, case, allowed, seed))
            on_outcome(outcomes[-1])
    return [outcome for outcomes in by_rig for outcome in outcomes]


def _in_lock_step(
    trials: Sequence[FaultTrial], jobs: int, seed: int | None, on_outcome: OnOutcome
) -> list[list[CaseResult]]:
    with process_pool(jobs) as pool:
        ready = {index: pool.submit(prepare, trial.rig, seed) for index, trial in enumerate(trials) if trial.cases}
        futures = [
            [pool.submit(rehearse, ready[index].result(), case, seed) for case in trial.cases]
            for index, trial in enumerate(trials)
        ]
        for done in as_completed([future for row in futures for future in row]):
            on_outcome(done.result())
        return [[future.result() for future in row] for row in futures]
