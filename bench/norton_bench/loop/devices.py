"""The devices of one bench as the loop handles them, opened, watched and stopped together, and their guard."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from math import inf, nan
from typing import Any

from norton_bench.errors import ExperimentError, RigError, SafetyStopError
from norton_bench.guard.check import Commands, DriveHealth
from norton_bench.guard.guard import Equipment, Guard, checks_for
from norton_bench.records import STREAMS, Stream
from norton_bench.rig.driver_options import wrong_unit_of
from norton_bench.rig.rig import Rig
from norton_drivers.devices import Amplifier, Device, TorqueSensor
from norton_drivers.link import Link
from norton_drivers.ports import Backend, Clock
from norton_drivers.readings import DeviceIdentity, DriveState
from norton_drivers.registry import open_amplifier, open_device, open_torque_sensor


@dataclass(frozen=True)
class WatchdogFinding:
    """The result of testing one drive's watchdog.

    ``safe_after_s`` is the time from the last command until the drive was safe; None where ``why`` gives the reason.
    """

    role: str
    safe_after_s: float | None = None
    why: str = ""

    def __str__(self) -> str:
        if self.safe_after_s is None:
            return f"watchdog of {self.role} not verified: {self.why}"
        return f"watchdog of {self.role} verified: {self.safe_after_s * 1e3:.0f} ms"


def has_none(drive: Amplifier) -> WatchdogFinding:
    """The result for a drive without a watchdog."""
    return WatchdogFinding(drive.role, why="it has none that is switched on; if this program dies, it goes on driving")


def fall_silent(drives: Sequence[Amplifier], link: Link) -> dict[str, WatchdogFinding]:
    """Send no more commands to the enabled ``drives``, and wait until each has made itself safe; results by role.

    Each has its watchdog's time, and the time in which its heartbeat reports it. Raises SafetyStopError for a drive
    that does not make itself safe, and ConnectionFailedError.
    """
    for drive in drives:
        drive.provoke_watchdog()
    silent_ns = link.clock.now_ns()
    found: dict[str, WatchdogFinding] = {}
    while len(found) < len(drives):
        link.wait()
        after_s = (link.clock.now_ns() - silent_ns) * 1e-9
        for drive in drives:
            if drive.role not in found and (finding := _look(drive, after_s)) is not None:
                found[drive.role] = finding
    return found


def _look(drive: Amplifier, after_s: float) -> WatchdogFinding | None:
    """None while the drive still has time. Raises SafetyStopError afterwards."""
    safe = drive.made_itself_safe()
    if safe:
        return WatchdogFinding(drive.role, after_s)
    if after_s < drive.watchdog_s + drive.heartbeat_timeout_ns * 1e-9:
        return None
    if safe is None:
        return WatchdogFinding(drive.role, why="this drive does not show what its watchdog does")
    raise SafetyStopError(
        f"{drive.role} drive: still enabled {after_s * 1e3:.0f} ms after the last command, though its watchdog is to "
        f"stop it after {drive.watchdog_s * 1e3:g} ms: set the watchdog in the drive and in [{drive.role}] of the rig "
        "file; or, at your own risk, [guard] verify_watchdogs = false",
        "watchdog",
    )


# A drive reports that it is idle with its next heartbeat; waiting longer than this is pointless.
IDLE_WITHIN_NS = 500_000_000
# The command to idle is repeated after so long: a frame may have been lost.
STOP_AGAIN_NS = 50_000_000
# Streams that never begin are reported by name after this long.
STREAMS_WITHIN_NS = 1_000_000_000


# What arrived since the last tick, oldest first, by the stream's name; no entry where nothing did.
Arrivals = dict[str, list[Any]]


def add(arrivals: Arrivals, later: Arrivals) -> None:
    """Put what arrived ``later`` behind ``arrivals``."""
    for name, readings in later.items():
        if name in arrivals:
            arrivals[name] += readings
        else:
            arrivals[name] = readings


@dataclass(frozen=True)
class Devices:
    """The actuator's amplifier and, where the rig has them, load drive, torque sensor and the actuator's modulator.

    ``sensors`` are those that nothing but the recording and the screen needs.
    """

    link: Link
    actuator: Amplifier
    load: Amplifier | None = None
    torque_sensor: TorqueSensor | None = None
    modulator: Amplifier | None = None
    sensors: tuple[Device, ...] = ()

    @property
    def clock(self) -> Clock:
        return self.link.clock

    @cached_property
    def drives(self) -> tuple[Amplifier, ...]:
        return tuple(drive for drive in (self.actuator, self.load, self.modulator) if drive is not None)

    def all(self) -> tuple[Device, ...]:
        """Every device of the rig."""
        sensor = () if self.torque_sensor is None else (self.torque_sensor,)
        return (*self.drives, *sensor, *self.sensors)

    @cached_property
    def streams(self) -> tuple[tuple[Stream, Callable[[], list[Any]]], ...]:
        """Every stream that the devices give, each with what takes its new readings."""
        devices: dict[str, Device | None] = {
            "actuator": self.actuator,
            "load": self.load,
            "torque_sensor": self.torque_sensor,
            "modulator": self.modulator,
            **{sensor.role: sensor for sensor in self.sensors},
        }
        return tuple(
            (stream, getattr(device, stream.kind.take))
            for stream in STREAMS
            if (device := devices.get(stream.role)) is not None
        )

    @cached_property
    def _takes(self) -> tuple[tuple[str, Callable[[], list[Any]]], ...]:
        return tuple((stream.name, take) for stream, take in self.streams)

    def receive(self) -> Arrivals:
        """Everything that has arrived. Raises ConnectionFailedError where a port is lost."""
        self.link.poll()
        return {name: readings for name, take in self._takes if (readings := take())}

    def send(self, commands: Commands) -> Commands:
        """Returns what the wires carry, which is what acts: each protocol rounds in its way.

        Raises ConnectionFailedError.
        """
        command = self.actuator.command(commands.command)
        load_nm = commands.load_torque_nm if self.load is None else self.load.command(commands.load_torque_nm)
        modulation = nan if self.modulator is None else self.modulator.command(commands.modulation)
        return Commands(command, load_nm, commands.limited, modulation)

    def health(self) -> tuple[DriveHealth, ...]:
        """The last status of every drive."""
        return tuple([DriveHealth(drive.role, drive.status(), drive.heartbeat_timeout_ns) for drive in self.drives])

    def identify(self) -> list[DeviceIdentity]:
        """The identity of every device, as it states it. Raises DeviceError."""
        found = list[DeviceIdentity]()
        for device in self.all():
            self.link.poll()  # unread messages would leave no room in the buffer for the answer
            found.append(device.identify())
        return found

    def enable(self, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Close every drive's torque loop at zero torque. Raises DeviceError; the drives are then idle again.

        ``meanwhile`` is called again and again until all are enabled.
        """
        self._enable(self.drives, meanwhile)

    def verify_watchdogs(self) -> tuple[WatchdogFinding, ...]:
        """Enable the drives at zero, send nothing more, and wait until each has made itself safe; one result a drive.

        Nothing moves, and the drives are idle afterwards. Raises SafetyStopError where a watchdog does not act,
        DeviceError where a drive cannot be enabled.
        """
        watched = [drive for drive in self.drives if drive.watchdog_s > 0]
        if not watched:
            return tuple(has_none(drive) for drive in self.drives)
        try:
            self._enable(watched)
            found = fall_silent(watched, self.link)
        finally:
            self.stop()
        return tuple(found.get(drive.role) or has_none(drive) for drive in self.drives)

    def stop(self) -> tuple[str, ...]:
        """Command zero torque to every drive, then idle it, in any state of the bench; returns what failed, never
        raises.

        All drives get zero before the first is idled. A drive that fails does not keep the others from being stopped.
        """
        self.zero()
        return (*self.tell_idle(), *self.await_idle())

    def zero(self) -> None:
        """Command zero torque to every drive; never raises."""
        for drive in self.drives:
            with suppress(Exception):  # what cannot be sent is complained of by tell_idle and await_idle
                drive.command(0.0)

    def tell_idle(self) -> tuple[str, ...]:
        """Tell every drive to idle; returns what failed, never raises."""
        complaints = list[str]()
        for drive in self.drives:
            self._idle(drive, complaints)
        return tuple(complaints)

    def _enable(self, drives: Sequence[Amplifier], meanwhile: Callable[[], None] = lambda: None) -> None:
        enabled: list[Amplifier] = []

        def feed_watchdogs() -> None:
            meanwhile()
            for drive in enabled:
                drive.command(0.0)

        self.link.keep_alive = feed_watchdogs
        try:
            self.link.poll()  # as before asking who they are
            for drive in drives:
                drive.enable()
                enabled.append(drive)
            feed_watchdogs()
        except BaseException:
            self.link.keep_alive = None
            self.stop()
            raise
        self.link.keep_alive = None

    def _idle(self, drive: Amplifier, complaints: list[str]) -> None:
        try:
            drive.stop()
        except Exception as error:  # no driver may; should one all the same, the other drive is still to be stopped
            complaints.append(f"{drive.role} drive: its driver failed to stop it ({error}): switch off its supply")

    def await_idle(self) -> tuple[str, ...]:
        """Repeat the command to idle until all are; a port that is lost does not end that for the others."""
        began_ns = told_ns = self.clock.now_ns()
        unheard: Exception | None = None
        while (enabled := self._still_enabled()) and self.clock.now_ns() - began_ns < IDLE_WITHIN_NS:
            if self.clock.now_ns() - told_ns >= STOP_AGAIN_NS:
                told_ns = self.clock.now_ns()
                for drive in enabled:
                    self._idle(drive, [])
            try:
                self.link.wait()
            except Exception as error:  # a stop must reach its end; the reason is reported
                unheard = error
        why = "" if unheard is None else f" (they cannot all be heard: {unheard})"
        return tuple(
            f"{drive.role} drive: told to idle, but still says that it is enabled{why}: switch off its supply"
            for drive in enabled
        )

    def _still_enabled(self) -> list[Amplifier]:
        return [drive for drive in self.drives if drive.status().state is DriveState.ENABLED]

    def await_streams(self) -> Arrivals:
        """Wait until every required stream and every heartbeat has come; returns what arrived meanwhile.

        While a controller is designed nobody reads, and heartbeats are lost in full buffers. Raises ExperimentError
        with the names of those that do not come.
        """
        deadline_ns = self.clock.now_ns() + STREAMS_WITHIN_NS
        arrived = self.receive()
        while self._silent(arrived) and self.clock.now_ns() < deadline_ns:
            self.link.wait()
            add(arrived, self.receive())
        if missing := self._silent(arrived):
            raise ExperimentError(
                f"no readings from: {', '.join(missing)}; check power, cable and the device's cyclic messages"
            )
        return arrived

    def _silent(self, arrived: Arrivals) -> list[str]:
        silent = [each.source for each, _ in self.streams if each.required and each.name not in arrived]
        return [*silent, *(f"{drive.role} drive's heartbeat" for drive in self.drives if self._beats_late(drive))]

    def _beats_late(self, drive: Amplifier) -> bool:
        """Whether its last heartbeat is older than half of what stops a segment; enabling waits for a first one."""
        heartbeat_ns = drive.status().heartbeat_ns
        return heartbeat_ns is not None and self.clock.now_ns() - heartbeat_ns > drive.heartbeat_timeout_ns / 2


def open_devices(rig: Rig, backend: Backend) -> Devices:
    """Open the rig's ports and drivers; nothing moves. Raises WiringError, RigError, ConnectionFailedError."""
    wiring = rig.wiring
    link = Link(backend, wiring.buses)
    try:
        devices = Devices(
            link,
            open_amplifier(wiring.actuator, link),
            open_amplifier(wiring.load, link) if wiring.load is not None else None,
            open_torque_sensor(wiring.torque_sensor, link) if wiring.torque_sensor is not None else None,
            open_amplifier(wiring.modulator, link) if wiring.modulator is not None else None,
            tuple(open_device(sensor, link) for sensor in wiring.sensors),
        )
        check_command_units(rig, devices)
    except BaseException:
        link.close()
        raise
    return devices


def check_command_units(rig: Rig, devices: Devices) -> None:
    """Whether each drive takes commands in the unit it is given them. Raises RigError."""
    settings = {device.role: device for device in rig.wiring.devices()}
    for drive in devices.drives:
        if wrong := wrong_unit_of(rig, settings[drive.role], drive.command_unit):
            raise RigError(f"{rig.place}: {wrong}")


def guard_for(rig: Rig, devices: Devices) -> Guard:
    """The guard with every plausibility check that the bench has signals for, but those that the rig leaves out."""
    load, sensor, modulator = devices.load, devices.torque_sensor, devices.modulator
    equipment = Equipment(
        load=load is not None,
        torque_sensor=sensor is not None,
        # What is no motor, or holds a position, may be a spring: it stands still under its greatest command.
        runs=rig.wiring.shaft == "free" and not rig.may_be_a_spring,
        range_nm=inf if sensor is None else sensor.range_nm,
        resolution_rad=devices.actuator.position_resolution_rad,
        load_resolution_rad=0.0 if load is None else load.position_resolution_rad,
        modulation=rig.modulation,
        modulator_resolution_rad=0.0 if modulator is None else modulator.position_resolution_rad,
    )
    checks = checks_for(rig.limits, rig.command, rig.tick_s, equipment, rig.supervision.leave_out)
    modulation_limit = None if rig.modulation is None else rig.modulation.limit
    return Guard(
        rig.limits,
        rig.command.limit,
        rig.tick_s,
        equipment.load,
        equipment.torque_sensor,
        checks,
        modulation_limit,
        0.0 if rig.wiring.load is None else rig.wiring.load.dead_band,
    )
