"""The devices of one bench as the loop handles them: opened, enabled, received from, sent to and stopped together."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from math import nan

from norton_bench.errors import ExperimentError, RigError
from norton_bench.guard.check import Commands, DriveHealth
from norton_bench.loop.watchdogs import WatchdogFinding, fall_silent, has_none
from norton_bench.rig.driver_options import wrong_unit_of
from norton_bench.rig.rig import Rig
from norton_drivers.devices import Amplifier, Device, TorqueSensor
from norton_drivers.link import Link
from norton_drivers.ports import Backend, Clock
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveState, MotionReading, TorqueReading
from norton_drivers.registry import open_amplifier, open_torque_sensor

# A drive that was told to idle says so with its next heartbeat; waiting longer than this is pointless.
IDLE_WITHIN_NS = 500_000_000
# It is told again as often as this, should a frame have been lost.
STOP_AGAIN_NS = 50_000_000
# Streams that never begin are reported by name after this long.
STREAMS_WITHIN_NS = 1_000_000_000


@dataclass(slots=True)
class Arrivals:
    """What arrived since the last tick, oldest first."""

    motion: list[MotionReading] = field(default_factory=list)
    load_motion: list[MotionReading] = field(default_factory=list)
    torque: list[TorqueReading] = field(default_factory=list)
    current: list[CurrentReading] = field(default_factory=list)
    load_current: list[CurrentReading] = field(default_factory=list)
    modulator_motion: list[MotionReading] = field(default_factory=list)
    modulator_current: list[CurrentReading] = field(default_factory=list)

    def add(self, later: "Arrivals") -> None:
        """What arrived after these."""
        self.motion += later.motion
        self.load_motion += later.load_motion
        self.torque += later.torque
        self.current += later.current
        self.load_current += later.load_current
        self.modulator_motion += later.modulator_motion
        self.modulator_current += later.modulator_current


@dataclass(frozen=True)
class Devices:
    """The actuator's amplifier and, where the rig has them, load drive, torque sensor and the actuator's modulator."""

    link: Link
    actuator: Amplifier
    load: Amplifier | None = None
    torque_sensor: TorqueSensor | None = None
    modulator: Amplifier | None = None

    @property
    def clock(self) -> Clock:
        return self.link.clock

    @cached_property
    def drives(self) -> tuple[Amplifier, ...]:
        return tuple(drive for drive in (self.actuator, self.load, self.modulator) if drive is not None)

    def all(self) -> tuple[Device, ...]:
        """Every device that is there."""
        return self.drives if self.torque_sensor is None else (*self.drives, self.torque_sensor)

    def receive(self) -> Arrivals:
        """Everything that has arrived. Raises ConnectionFailedError where a port is lost."""
        self.link.poll()
        load, sensor, modulator = self.load, self.torque_sensor, self.modulator
        return Arrivals(
            self.actuator.take_motion(),
            [] if load is None else load.take_motion(),
            [] if sensor is None else sensor.take_torque(),
            self.actuator.take_current(),
            [] if load is None else load.take_current(),
            [] if modulator is None else modulator.take_motion(),
            [] if modulator is None else modulator.take_current(),
        )

    def send(self, commands: Commands) -> Commands:
        """Returns what the wires carry, which is what acts: each protocol rounds in its way.

        Raises ConnectionFailedError.
        """
        command = self.actuator.command(commands.command)
        load_nm = commands.load_torque_nm if self.load is None else self.load.command(commands.load_torque_nm)
        modulation = nan if self.modulator is None else self.modulator.command(commands.modulation)
        return Commands(command, load_nm, commands.limited, modulation)

    def health(self) -> tuple[DriveHealth, ...]:
        """The last word of every drive."""
        return tuple([DriveHealth(drive.role, drive.status(), drive.heartbeat_timeout_ns) for drive in self.drives])

    def identify(self) -> list[DeviceIdentity]:
        """Who everybody says to be. Raises DeviceError."""
        found = list[DeviceIdentity]()
        for device in self.all():
            self.link.poll()  # what piled up while nobody looked would leave no room for the answer
            found.append(device.identify())
        return found

    def enable(self) -> None:
        """Close every drive's torque loop at zero torque. Raises DeviceError; the drives are then idle again."""
        self._enable(self.drives)

    def verify_watchdogs(self) -> tuple[WatchdogFinding, ...]:
        """Enable the drives at zero, fall silent, and see each make itself safe; one finding for each drive.

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
        """Every drive to zero torque and idle, whatever state the bench is in. Returns complaints, never raises.

        All get their zero before any is idled; a drive that fails does not keep the others from it.
        """
        complaints = list[str]()
        for drive in self.drives:
            with suppress(Exception):  # what cannot be sent is tried again below, and complained of at the end
                drive.command(0.0)
        for drive in self.drives:
            self._idle(drive, complaints)
        return (*complaints, *self._await_idle())

    def _enable(self, drives: Sequence[Amplifier]) -> None:
        enabled: list[Amplifier] = []

        def feed_watchdogs() -> None:
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

    def _await_idle(self) -> tuple[str, ...]:
        """Tell those that are still enabled again and again; what is lost of one port does not end it for the other."""
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
        """Let every stream begin, and every drive give a sign of life; returns what arrived meanwhile.

        A bench that was not listened to for a while, because a controller was designed, has lost heartbeats in full
        buffers. Raises ExperimentError naming those that do not come.
        """
        deadline_ns = self.clock.now_ns() + STREAMS_WITHIN_NS
        arrived = self.receive()
        while self._silent(arrived) and self.clock.now_ns() < deadline_ns:
            self.link.wait()
            arrived.add(self.receive())
        if missing := self._silent(arrived):
            raise ExperimentError(
                f"no readings from: {', '.join(missing)}; check power, cable and the device's cyclic messages"
            )
        return arrived

    def _silent(self, arrived: Arrivals) -> list[str]:
        streams = (
            ("actuator encoder", True, arrived.motion),
            ("load encoder", self.load is not None, arrived.load_motion),
            ("torque sensor", self.torque_sensor is not None, arrived.torque),
            ("modulator encoder", self.modulator is not None, arrived.modulator_motion),
        )
        silent = [name for name, expected, readings in streams if expected and not readings]
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
