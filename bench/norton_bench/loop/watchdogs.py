"""The drives' own watchdogs, seen to act: what a drive does when the host dies is found out before it matters."""

from collections.abc import Sequence
from dataclasses import dataclass

from norton_bench.errors import SafetyStopError
from norton_drivers.devices import Amplifier
from norton_drivers.link import Link


@dataclass(frozen=True)
class WatchdogFinding:
    """``safe_after_s``: from the last command until the drive was seen to be safe; None where ``why`` says why not."""

    role: str
    safe_after_s: float | None = None
    why: str = ""

    def __str__(self) -> str:
        if self.safe_after_s is None:
            return f"watchdog of {self.role} not verified: {self.why}"
        return f"watchdog of {self.role} verified: {self.safe_after_s * 1e3:.0f} ms"


def has_none(drive: Amplifier) -> WatchdogFinding:
    """Of a drive that nobody expects to stop by itself."""
    return WatchdogFinding(drive.role, why="it has none that is switched on; if this program dies, it goes on driving")


def fall_silent(drives: Sequence[Amplifier], link: Link) -> dict[str, WatchdogFinding]:
    """Command the enabled ``drives`` no more, and watch until each has made itself safe; findings by role.

    Each has its watchdog's time, and that in which it would tell. Raises SafetyStopError for one that does not, and
    ConnectionFailedError.
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
    """None while there is still time. Raises SafetyStopError where there is none left."""
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
