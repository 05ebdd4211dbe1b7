"""A long session in lock step: does the memory stay, do the clocks stay together, can the recording be read meanwhile.

    python benchmarks/soak.py --ticks 1000000 [--json] [--looks 10]

The session is a real one, on the simulated bench through real frames: tare and calibration, then free and imposed
motion in turn for as long as it takes. While it runs, the memory of both processes is read from /proc, and the growing
recording is opened by another process. Memory must not grow once the first fifth is over; ticks must keep their grid,
readings their age and their rate, the sensor's clock its pace against the bench's.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from norton_bench.events import Note, PartMeasured, SessionEvent
from norton_bench.procedures.catalogue import make_procedures
from norton_bench.procedures.options import CalibrateOptions, FreeOptions, ImposedOptions, TareOptions
from norton_bench.recording.reader import read_so_far
from norton_bench.records import NO_DEVICE_TIME, Measured, Table
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.session.engine import record_session
from norton_bench.session.schema import Session, Step

Stamps = npt.NDArray[np.int64]

ROOT = Path(__file__).parents[1]
RIG = ROOT / "rigs" / "sim-odrive.toml"
BEGIN = (Step("tare", TareOptions(duration_s=0.5)), Step("calibrate", CalibrateOptions(duration_s=4.0)))
TURN = (
    Step("free", FreeOptions(levels=3, dwell_s=0.2, duration_s=10.0)),
    Step("imposed", ImposedOptions(velocities_rad_s=(-20.0, 20.0), commands=2, duration_s=10.0)),
)
SAMPLE_EVERY_TICKS = 10_000
WARM_UP_SHARE = 0.2
# Growth that is not told from the noise of an allocator.
ALLOWED_GROWTH_MB = 10.0
# What the sensor's clock runs fast or slow by stays the same; and readings stay as old as they were, to a period.
ALLOWED_PACE_PPM, ALLOWED_AGE_MS = 0.05, 1.0
AGES = ("torque", "motion", "load_motion")
# Plans are estimates; they have always been met by this share at least.
PLANNED_SHARE = 0.9
MEGA = 1e6


@dataclass
class Watch:
    """Looks at memory and recording as the session goes on."""

    path: Path
    looks_at: list[int]
    ticks: int = 0
    memory: list[tuple[int, float, float]] = field(default_factory=list)  # ticks, MB of session and of recorder
    looks: list[dict[str, float]] = field(default_factory=list)
    begun_s: float = field(default_factory=time.perf_counter)
    notes: list[str] = field(default_factory=list)

    def __call__(self, event: SessionEvent) -> None:
        match event:
            case PartMeasured(measured):
                self._take(measured)
            case Note(text):
                self.notes.append(text)

    def _take(self, measured: Measured) -> None:
        before, self.ticks = self.ticks, self.ticks + len(measured.ticks)
        if before // SAMPLE_EVERY_TICKS < self.ticks // SAMPLE_EVERY_TICKS:
            self.memory.append((self.ticks, anonymous_mb(os.getpid()), anonymous_mb(recorder_pid())))
        if self.looks_at and self.ticks >= self.looks_at[0]:
            self.looks_at.pop(0)
            self._look(int(measured.ticks["tick_ns"][-1]))
            print(f"{self.ticks} ticks, {self.memory[-1:]}, {self.looks[-1]}", file=sys.stderr)

    def _look(self, now_ns: int) -> None:
        """In another process: what it needs of memory is not the session's."""
        done = subprocess.run(
            [sys.executable, __file__, "--look", str(self.path)],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        seen = json.loads(done.stdout)
        self.looks.append(
            {
                "ticks": self.ticks,
                "readable": seen["ticks"],
                "behind_ms": (now_ns - seen["last_ns"]) / MEGA,
                "took_s": seen["took_s"],
            }
        )


def look(path: Path) -> None:
    begun_s = time.perf_counter()
    measured = read_so_far(path, raw_frames=False).measured
    took_s = time.perf_counter() - begun_s
    print(json.dumps({"ticks": len(measured.ticks), "last_ns": int(measured.ticks["tick_ns"][-1]), "took_s": took_s}))


def anonymous_mb(pid: int) -> float:
    """Memory that only this process has [MB]: without what is mapped from files, which the system may take back."""
    status = Path(f"/proc/{pid}/status").read_text()
    kilobytes = next(line.split()[1] for line in status.splitlines() if line.startswith("RssAnon"))
    return int(kilobytes) * 1024 / MEGA


def recorder_pid() -> int:
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    return next(int(pid) for pid in children if b"recording.writer" in Path(f"/proc/{pid}/cmdline").read_bytes())


def session_of(rig: Rig, ticks: int) -> Session:
    """As many turns as take at least so many ticks."""

    def planned_s(steps: tuple[Step, ...]) -> float:
        procedures = make_procedures([(step.do, step.options) for step in steps], rig, place="soak")
        return sum(procedure.duration_s(rig) for procedure in procedures)

    before_s = planned_s(BEGIN)
    turns = int(np.ceil((ticks * rig.tick_s / PLANNED_SHARE - before_s) / (planned_s(BEGIN + TURN) - before_s)))
    return Session(BEGIN + TURN * max(turns, 1), place="soak")


def growth_mb(memory: list[tuple[int, float, float]], column: int) -> dict[str, float]:
    """After the warm-up: the memory at its beginning, and by how much a line through it rises to the end [MB]."""
    ticks = np.array([row[0] for row in memory], float)
    settled = ticks > WARM_UP_SHARE * ticks[-1]
    ticks, used = ticks[settled], np.array([row[column] for row in memory])[settled]
    slope = np.polyfit(ticks, used, 1)[0]
    return {
        "first_mb": float(used[0]),
        "last_mb": float(used[-1]),
        "greatest_mb": float(used.max()),
        "growth_mb": float(slope * (ticks[-1] - ticks[0])),
        "growth_mb_per_million_ticks": float(slope * MEGA),
    }


def clocks(measured: Measured, tick_ns: int) -> dict[str, Any]:
    """How well times agree with each other, in the first and the last tenth."""
    within = np.concatenate([steps_within(measured, segment.start_ns, segment.end_ns) for segment in measured.segments])
    ends = np.array_split(measured.ticks, 10)[::9]
    torque = measured.torque[measured.torque["device_ns"] != NO_DEVICE_TIME]
    return {
        "ticks_off_the_grid": int(np.count_nonzero(within != tick_ns)),
        "greatest_age_ms": {name: [float(end[f"{name}_age_ns"].max()) / MEGA for end in ends] for name in AGES},
        "rate_hz": {
            name: [rate_hz(part) for part in np.array_split(getattr(measured, name), 10)[::9]]
            for name in (*AGES, "current")
        },
        "sensor_clock_ppm": [
            pace_ppm(part["arrival_ns"], part["device_ns"] - part["arrival_ns"]) for part in np.array_split(torque, 2)
        ],
    }


def steps_within(measured: Measured, start_ns: int, end_ns: int) -> Stamps:
    stamps = measured.ticks["tick_ns"]
    return np.diff(stamps[np.searchsorted(stamps, start_ns) : np.searchsorted(stamps, end_ns)])


def pace_ppm(stamp_ns: Stamps, difference_ns: Stamps) -> float:
    """The slope of a difference of times over time."""
    return float(np.polyfit(stamp_ns - stamp_ns[0], difference_ns - difference_ns[0], 1)[0] * MEGA)


def rate_hz(readings: Table) -> float:
    """By sequence numbers, so that a session's pauses, in which drives go on speaking, count for nothing."""
    span_ns, count = np.ptp(readings["arrival_ns"]), np.ptp(readings["sequence"])
    return float(count / (span_ns * 1e-9))


def soak(ticks: int, looks: int) -> dict[str, Any]:
    rig = load_rig(RIG)
    session = session_of(rig, ticks)
    with tempfile.TemporaryDirectory(dir="/tmp") as name:
        out = Path(name)
        path = out / f"{rig.name}.mcap"
        watch = Watch(path, [ticks * (k + 1) // (looks + 1) for k in range(looks)])
        done = record_session(replace(rig, candump=True), session, out=out, seed=1, on_event=watch)
        took_s = time.perf_counter() - watch.begun_s
        sizes = {each.name: each.stat().st_size for each in out.iterdir()}
    found = {
        "ticks": len(done.measured.ticks),
        "procedures": len(session.steps),
        "took_s": took_s,
        "session": growth_mb(watch.memory, 1),
        "recorder": growth_mb(watch.memory, 2),
        "peak_with_reading_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / MEGA,
        "looks": watch.looks,
        "clocks": clocks(done.measured, rig.tick_ns),
        "bytes_a_tick": {name: size / watch.ticks for name, size in sizes.items()},
        "lost_ticks": watch.ticks - len(done.measured.ticks),
    }
    return {**found, "held": held(found)}


def held(found: dict[str, Any]) -> bool:
    steady = all(found[name]["growth_mb"] < ALLOWED_GROWTH_MB for name in ("session", "recorder"))
    clock = found["clocks"]
    young = all(abs(last - first) <= ALLOWED_AGE_MS for first, last in clock["greatest_age_ms"].values())
    paced = bool(np.ptp(clock["sensor_clock_ppm"]) <= ALLOWED_PACE_PPM)
    whole = found["lost_ticks"] == 0 and clock["ticks_off_the_grid"] == 0
    return steady and young and paced and whole


def told(found: dict[str, Any]) -> str:
    lines = [f"{found['ticks']} ticks in {found['procedures']} procedures, {found['took_s']:.0f} s"]
    lines += [
        f"{name}: {one['first_mb']:.0f} MB, then {one['growth_mb_per_million_ticks']:+.1f} MB per million ticks, "
        f"{one['greatest_mb']:.0f} MB at most"
        for name in ("session", "recorder")
        if (one := found[name])
    ]
    clock = found["clocks"]
    ages = clock["greatest_age_ms"].items()
    lines += [
        f"read while it grew: {len(found['looks'])} times, "
        f"{max((each['behind_ms'] for each in found['looks']), default=0):.0f} ms behind at most",
        f"ticks off their grid: {clock['ticks_off_the_grid']}; greatest age in the first and the last tenth: "
        + ", ".join(f"{name} {first:.2f} and {last:.2f} ms" for name, (first, last) in ages),
        f"sensor's clock against the bench's, first and second half: {clock['sensor_clock_ppm']} ppm",
    ]
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=1_000_000)
    parser.add_argument("--looks", type=int, default=10)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--look", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.look is not None:
        look(asked.look)
        return 0
    found = soak(asked.ticks, asked.looks)
    print(json.dumps(found, indent=2) if asked.json else told(found))
    return 0 if found["held"] else 1


if __name__ == "__main__":
    sys.exit(main())
