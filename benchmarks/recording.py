"""What recording costs, and what a crash costs.

Prints, for a bench at 1 kHz with five streams and five raw frames a tick: the time that handing over takes from the
caller, the time that writing takes, the size of the file, the time to read it back; then the rows lost when both the
experiment and its recording process are killed.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from io import FileIO
from pathlib import Path

import numpy as np

from norton_bench.recording import wire
from norton_bench.recording.reader import read_recording
from norton_bench.recording.recorder import Recorder
from norton_bench.recording.recover import recover
from norton_bench.recording.writer import RecordingFile
from norton_bench.records import CURRENT, MOTION, TICK, TORQUE, Measured, Table
from norton_drivers.readings import RawFrame

TICK_NS = 1_000_000
PART_TICKS = 100
SECONDS = 20
KILLS = 10


def filled(dtype: np.dtype[np.void], first: int, count: int, rng: np.random.Generator) -> Table:
    """Rows that compress no better than measurements do."""
    table = np.zeros(count, dtype)
    for name in dtype.names or ():
        if dtype[name].kind == "f":
            table[name] = rng.normal(size=count)
        elif name in ("tick_ns", "arrival_ns", "device_ns"):
            table[name] = (first + np.arange(count)) * TICK_NS + rng.integers(0, 50_000, count)
        elif name.endswith("_ns"):
            table[name] = rng.integers(0, 300_000, count)
    if "sequence" in (dtype.names or ()):
        table["sequence"] = first + np.arange(count)
    return table


def part(first: int, rng: np.random.Generator) -> Measured:
    """100 ms of a dynamometer."""
    frames = tuple(
        RawFrame((first + tick) * TICK_NS + 1000 * slot, name, slot > 2, rng.bytes(size), node, False, False)
        for tick in range(PART_TICKS)
        for slot, (name, node, size) in enumerate(
            [("can0", 0x29, 8), ("can0", 0x49, 8), ("/dev/ttyUSB0", -1, 38), ("can0", 0x2E, 8), ("can0", 0x4E, 8)]
        )
    )
    return Measured(
        ticks=filled(TICK, first, PART_TICKS, rng),
        motion=filled(MOTION, first, PART_TICKS, rng),
        load_motion=filled(MOTION, first, PART_TICKS, rng),
        torque=filled(TORQUE, first, PART_TICKS, rng),
        current=filled(CURRENT, first, PART_TICKS, rng),
        frames=frames,
    )


def say(label: str, value: float, meaning: str) -> None:
    print(f"{label:24}{value:8.2f} {meaning}")


def cost(folder: Path) -> None:
    rng = np.random.default_rng(1)
    parts = [part(first, rng) for first in range(0, SECONDS * 1000, PART_TICKS)]
    cost_of_writing(folder / "cost.mcap", parts)
    cost_of_reading(folder / "cost.mcap")
    cost_end_to_end(folder / "flow.mcap", parts)


def cost_of_writing(path: Path, parts: list[Measured]) -> None:
    ticks = SECONDS * 1000
    start_s = time.process_time()
    sent = [wire.part_of(piece) for piece in parts]
    say("making a part ready", (time.process_time() - start_s) / ticks * 1e6, "µs a tick, in the experiment's process")
    with FileIO(path, "wb") as file:
        start_s = time.process_time()
        recording = RecordingFile(file, "", {})
        for piece in sent:
            recording.add(piece)
        recording.finish({"ended": "in good order", "dropped_parts": "0"})
        spent_s = time.process_time() - start_s
    say("writing", spent_s / ticks * 1e6, "µs a tick, in the recording process")
    say("", SECONDS / spent_s, "times real time")
    say("file", recording.size / ticks, "bytes a tick")


def cost_of_reading(path: Path) -> None:
    for frames in (False, True):
        start_s = time.perf_counter()
        read_recording(path, raw_frames=frames)
        spent_s = (time.perf_counter() - start_s) / SECONDS * 100
        say("reading", spent_s, f"s for 100 s of bench time, {'with' if frames else 'without'} raw frames")


def cost_end_to_end(path: Path, parts: list[Measured]) -> None:
    start_s = time.perf_counter()
    with Recorder(path, rig_text="", metadata={}, patience_s=10.0) as recorder:
        started_s = time.perf_counter()
        for piece in parts:
            recorder.put(piece)
    flow_s = time.perf_counter() - started_s
    say("starting the recorder", started_s - start_s, "s")
    say("end to end", SECONDS / flow_s, "times real time, wall")


def forever(path: Path) -> None:
    """Record a second in real time, in which this process will be killed; says who else is to be killed."""
    rng = np.random.default_rng(2)
    pieces = [part(first, rng) for first in range(0, 1000, PART_TICKS)]
    with Recorder(path, rig_text="", metadata={}) as recorder:
        print(recorder.writer_pid, flush=True)
        begin_s = time.monotonic()
        for number, piece in enumerate(pieces):
            time.sleep(max(0.0, begin_s + 0.1 * (number + 1) - time.monotonic()))
            recorder.put(piece)


def loss(folder: Path) -> None:
    rng = np.random.default_rng(3)
    lost = []
    for number in range(KILLS):
        path = folder / f"kill{number}.mcap"
        with subprocess.Popen([sys.executable, __file__, str(path)], stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            writer_pid = int(process.stdout.readline())
            begin_s = time.monotonic()
            time.sleep(rng.uniform(0.3, 0.9))
            os.kill(writer_pid, signal.SIGKILL)
            process.kill()
            elapsed_ms = (time.monotonic() - begin_s) * 1e3
        recover(path)
        kept = len(read_recording(path.with_name(f"{path.stem}.recovered.mcap")).measured.ticks)
        lost.append(elapsed_ms - kept)
    say("rows lost on a kill", float(np.median(lost)), f"of 1000 a second, median of {KILLS}; {max(lost):.0f} at most")


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        cost(Path(folder))
        loss(Path(folder))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        forever(Path(sys.argv[1]))
    else:
        main()
