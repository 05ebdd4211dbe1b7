"""Both drives are stopped whatever becomes of either, told again until they confirm; and their watchdogs are tried."""

from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from norton_bench.errors import SafetyStopError
from norton_bench.loop.devices import Devices
from norton_bench.testing import ScriptedWorld
from norton_drivers.errors import ConnectionFailedError, DeviceError
from norton_drivers.link import Link
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveState, DriveStatus, MotionReading

WATCHDOG_S = 0.3
HEARTBEAT_NS = 100_000_000


@dataclass
class Drive:
    """Obeys at once, and notes what it was told with the time of it; each deed can be made to go wrong."""

    role: str
    world: ScriptedWorld
    watchdog_s: float = WATCHDOG_S
    shows: bool = True  # what its watchdog does
    acts: bool = True  # its watchdog
    told: list[tuple[int, str]] = field(default_factory=list)
    enabled: bool = False
    command_unit: str = "N*m"
    heartbeat_timeout_ns: int = HEARTBEAT_NS
    position_resolution_rad: float = 0.0
    deaf_to_stops: int = 0
    fails: Callable[[str], None] = lambda _deed: None
    _fed_ns: int = 0

    def _note(self, deed: str) -> None:
        self.told.append((self.world.clock.ns, deed))
        self.fails(deed)

    def deeds(self) -> list[str]:
        return [deed for _, deed in self.told]

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        return DeviceIdentity("scripted", self.role)

    def enable(self, timeout_s: float = 2.0) -> None:
        self._note("enable")
        self.enabled, self._fed_ns = True, self.world.clock.ns

    def command(self, value: float) -> None:
        self._note(f"command {value:g}")
        self._fed_ns = self.world.clock.ns

    def take_motion(self) -> list[MotionReading]:
        return []

    def take_current(self) -> list[CurrentReading]:
        return []

    def status(self) -> DriveStatus:
        return DriveStatus(DriveState.ENABLED if self.enabled else DriveState.IDLE, self.world.clock.ns)

    def provoke_watchdog(self) -> None:
        self._note("provoke")
        self._fed_ns = self.world.clock.ns

    def made_itself_safe(self) -> bool | None:
        if self.acts and self.world.clock.ns - self._fed_ns > self.watchdog_s * 1e9:
            self.enabled = False
        return not self.enabled if self.shows else None

    def stop(self) -> None:
        self._note("stop")
        if self.deaf_to_stops:
            self.deaf_to_stops -= 1
        else:
            self.enabled = False


@pytest.fixture
def world():
    made = ScriptedWorld()
    yield made
    made.close()


@pytest.fixture
def bench(world: ScriptedWorld) -> Devices:
    return Devices(Link(world, ()), Drive("actuator", world), Drive("load", world))


def both(bench: Devices) -> tuple[Drive, Drive]:
    actuator, load = bench.drives
    assert isinstance(actuator, Drive)
    assert isinstance(load, Drive)
    return actuator, load


def refuse(*deeds: str, error: type[Exception] = ConnectionFailedError) -> Callable[[str], None]:
    def fail(deed: str) -> None:
        if deed.split(maxsplit=1)[0] in deeds:
            raise error(f"cannot {deed}")

    return fail


# ---- Stopping -------------------------------------------------------------------------------------------------------


def test_both_get_their_zero_in_the_same_instant_before_either_is_idled(bench: Devices, world: ScriptedWorld) -> None:
    actuator, load = both(bench)
    bench.enable()
    order: list[tuple[str, str]] = []
    actuator.fails = lambda deed: order.append(("actuator", deed))
    load.fails = lambda deed: order.append(("load", deed))
    now_ns = world.clock.ns
    assert bench.stop() == ()
    assert order == [("actuator", "command 0"), ("load", "command 0"), ("actuator", "stop"), ("load", "stop")]
    assert world.clock.ns == now_ns


@pytest.mark.parametrize("ill", [0, 1])
@pytest.mark.parametrize("error", [ConnectionFailedError, DeviceError, RuntimeError])
def test_a_drive_that_fails_does_not_keep_the_other_from_stopping(
    bench: Devices, ill: int, error: type[Exception]
) -> None:
    bench.enable()
    drives = both(bench)
    drives[ill].fails = refuse("command", "stop", error=error)
    complaints = bench.stop()
    well = drives[1 - ill]
    assert (well.deeds()[-2:], well.enabled) == (["command 0", "stop"], False)
    name = drives[ill].role
    assert any(f"{name} drive: its driver failed to stop it (cannot stop)" in said for said in complaints)
    assert any(f"{name} drive: told to idle, but still says that it is enabled" in said for said in complaints)


def test_a_drive_that_missed_its_stop_is_told_again(bench: Devices) -> None:
    bench.enable()
    actuator, load = both(bench)
    load.deaf_to_stops = 3
    assert bench.stop() == ()
    assert [deed for deed in load.deeds() if deed == "stop"] == ["stop"] * 4
    assert [deed for deed in actuator.deeds() if deed == "stop"] == ["stop"]
    times_ns = [at_ns for at_ns, deed in load.told if deed == "stop"]
    assert times_ns[-1] - times_ns[0] == pytest.approx(150_000_000, abs=5_000_000)


def test_a_drive_that_never_confirms_is_complained_of(bench: Devices, world: ScriptedWorld) -> None:
    bench.enable()
    _, load = both(bench)
    load.deaf_to_stops = 1000
    began_ns = world.clock.ns
    (complaint,) = bench.stop()
    assert complaint == "load drive: told to idle, but still says that it is enabled: switch off its supply"
    assert world.clock.ns - began_ns == pytest.approx(500_000_000, abs=5_000_000)


def test_a_port_that_is_lost_does_not_end_the_stop_of_what_is_on_the_other(
    bench: Devices, world: ScriptedWorld
) -> None:
    bench.enable()
    _, load = both(bench)
    load.deaf_to_stops = 3

    def lost() -> None:
        raise ConnectionFailedError("bus can0: lost")

    bench.link.questions.append(lost)
    assert bench.stop() == ()
    load.enabled, load.deaf_to_stops = True, 1000
    (complaint,) = bench.stop()
    assert "(they cannot all be heard: bus can0: lost): switch off its supply" in complaint


# ---- Watchdogs ------------------------------------------------------------------------------------------------------


def test_watchdogs_are_seen_to_act(bench: Devices) -> None:
    findings = bench.verify_watchdogs()
    assert [str(finding) for finding in findings] == [
        "watchdog of actuator verified: 301 ms",
        "watchdog of load verified: 301 ms",
    ]
    for drive in both(bench):
        provoked = drive.deeds().index("provoke")
        assert drive.deeds()[provoked + 1 :] == ["command 0", "stop"]
        silent_ns = drive.told[provoked + 1][0] - drive.told[provoked][0]
        assert silent_ns == pytest.approx(301_000_000, abs=1_000_000)
        assert not drive.enabled


def test_all_fall_silent_until_the_last_is_safe(bench: Devices) -> None:
    both(bench)[1].watchdog_s = 0.5
    assert [finding.safe_after_s for finding in bench.verify_watchdogs()] == pytest.approx([0.301, 0.501], abs=1e-3)


@pytest.mark.parametrize("ill", [0, 1])
def test_a_watchdog_that_does_not_act_is_a_safety_stop(bench: Devices, world: ScriptedWorld, ill: int) -> None:
    drive = both(bench)[ill]
    drive.acts = False
    words = (
        rf"{drive.role} drive: still enabled 40\d ms after the last command, though its watchdog is to stop it after "
        rf"300 ms: set the watchdog in the drive and in \[{drive.role}\].*verify_watchdogs = false"
    )
    with pytest.raises(SafetyStopError, match=words) as stop:
        bench.verify_watchdogs()
    assert stop.value.by == "watchdog"
    assert [each.enabled for each in both(bench)] == [False, False]


def test_a_drive_that_cannot_show_its_watchdog_is_told_as_such(bench: Devices) -> None:
    both(bench)[1].shows = False
    assert [str(finding) for finding in bench.verify_watchdogs()] == [
        "watchdog of actuator verified: 301 ms",
        "watchdog of load not verified: this drive does not show what its watchdog does",
    ]


def test_a_drive_without_a_watchdog_is_told_as_such_and_not_enabled(bench: Devices) -> None:
    actuator, load = both(bench)
    load.watchdog_s = 0.0
    without = "watchdog of load not verified: it has none that is switched on; if this program dies, it goes on driving"
    assert [str(finding) for finding in bench.verify_watchdogs()] == ["watchdog of actuator verified: 301 ms", without]
    assert "enable" not in load.deeds()
    actuator.watchdog_s = 0.0
    actuator.told.clear()
    assert [finding.safe_after_s for finding in bench.verify_watchdogs()] == [None, None]
    assert actuator.told == []


def test_a_drive_that_cannot_be_enabled_ends_the_trial_with_all_idle(bench: Devices) -> None:
    actuator, load = both(bench)
    load.fails = refuse("enable", error=DeviceError)
    with pytest.raises(DeviceError, match="cannot enable"):
        bench.verify_watchdogs()
    assert (actuator.enabled, load.enabled) == (False, False)
    assert actuator.deeds()[-1] == "stop"
