"""What the screen costs: frames a second, processor time a frame, and the share of a core, in a real terminal.

The real app replays a real simulated experiment on a pseudo-terminal whose other end takes everything at once, at
several sizes, 25 frames a second asked. `figures_ms` is what the plots alone cost, without textual and the terminal;
`stop_ms` how long after the space bar the stop is said while the event loop is held up on purpose for half a second.
Shares are of one core, so quote ratios: the machine may be busy with others.

    python benchmarks/screen.py [--recording FILE] [--seconds 20] [--quick] [--json]
"""

import argparse
import asyncio
import fcntl
import json
import os
import pty
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
from pathlib import Path
from typing import Any

SIZES = ((80, 24), (120, 36), (160, 45), (200, 60))
QUICK_SIZES = ((80, 24), (200, 60))
BEGIN_S = 20.0
SPEED = 1.0
BUSY_S, PRESS_AFTER_S = 0.5, 4.0
CHILD = "--child"


def main() -> None:
    arguments = _arguments()
    with tempfile.TemporaryDirectory() as folder:
        recording = arguments.recording or recorded(Path(folder))
        seconds = 5.0 if arguments.quick else arguments.seconds
        sizes = QUICK_SIZES if arguments.quick else SIZES
        rows = [{**measured(recording, *size, seconds), "figures_ms": figures_ms(recording, *size)} for size in sizes]
        stop_ms = measured(recording, 120, 36, 3.0, stop=True)["stop_ms"]
    if arguments.json:
        print(json.dumps({"sizes": rows, "stop_while_busy_ms": stop_ms}, indent=2))
        return
    print("size      frames/s  processor ms/frame  share of a core  kB/s to the terminal  plots alone, ms/frame")
    for row in rows:
        size = f"{row['columns']}×{row['rows']}"
        print(
            f"{size:<10}{row['fps']:8.1f}{row['cpu_ms_a_frame']:20.1f}{100 * row['cpu_share']:15.0f} %"
            f"{row['kb_per_s']:22.0f}{row['figures_ms']:23.1f}"
        )
    print(f"stop said {stop_ms:.1f} ms after the space bar, with the event loop held up for {BUSY_S * 1e3:.0f} ms")


def measured(recording: Path, columns: int, rows: int, seconds: float, *, stop: bool = False) -> dict[str, Any]:
    """The app in a process of its own on a pseudo-terminal, and what it says of itself afterwards."""
    said = tempfile.NamedTemporaryFile(suffix=".json")  # noqa: SIM115  (closed below)
    what = [CHILD, str(recording), str(seconds), said.name, "stop" if stop else "watch"]
    child, ours = on_a_terminal([sys.executable, __file__, *what], columns, rows)
    taken, pressed_s = _drain(ours, child, press=stop)
    with said:
        found: dict[str, Any] = json.loads(Path(said.name).read_text() or "{}")
    if not found:
        raise SystemExit(f"the screen ended without a result (exit code {child.returncode})")
    if stop:
        found["stop_ms"] = 1e3 * (found.pop("said_s") - pressed_s)
    return {"columns": columns, "rows": rows, "kb_per_s": taken / 1e3 / seconds, **found}


def on_a_terminal(command: list[str], columns: int, rows: int) -> "tuple[subprocess.Popen[bytes], int]":
    """A process on a pseudo-terminal of this size, and the terminal's other end, which somebody must read."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    child = subprocess.Popen(
        command, stdin=theirs, stdout=theirs, stderr=theirs, env={**os.environ, "TERM": "xterm-256color"}
    )
    os.close(theirs)
    return child, ours


def _drain(ours: int, child: "subprocess.Popen[bytes]", *, press: bool) -> tuple[int, float]:
    """Take what is written until the child ends; returns how many bytes, and when the space bar was pressed [s]."""
    taken, pressed_s = 0, [float("nan")]

    def press_space() -> None:
        pressed_s[0] = time.monotonic()
        os.write(ours, b" ")

    while True:
        try:
            data = os.read(ours, 1 << 16)
        except OSError:  # the other end is closed
            break
        if not data:
            break
        if press and not taken:
            threading.Timer(PRESS_AFTER_S, press_space).start()
        taken += len(data)
    child.wait()
    os.close(ours)
    return taken, pressed_s[0]


def child(recording: Path, seconds: float, said: Path, *, stop: bool) -> None:
    """Run the app here, measure, and leave."""
    from norton_bench.screen.app import BenchApp  # noqa: PLC0415
    from norton_bench.screen.experiment import Opening, replayed  # noqa: PLC0415

    experiment = replayed(recording)
    experiment.seek(BEGIN_S)
    app = BenchApp(Opening(lambda _: Path()), experiment)
    found: dict[str, float] = {}
    said_at: list[float] = []
    if stop:
        experiment.source.stop = lambda _reason: said_at.append(time.monotonic())  # type: ignore[union-attr,method-assign]

    async def watch() -> None:
        await asyncio.sleep(1.0)
        frames, cpu_s, begun = app.screen.frames, time.process_time(), time.perf_counter()  # type: ignore[attr-defined]
        if stop:
            # The key comes some seconds after the first frame; the event loop is held up around that.
            while not said_at and time.perf_counter() - begun < 5 * PRESS_AFTER_S:
                held = time.perf_counter()
                while time.perf_counter() - held < BUSY_S:
                    pass
                await asyncio.sleep(0)
            found["said_s"] = said_at[0] if said_at else float("nan")
        else:
            await asyncio.sleep(seconds)
        took_s, drawn = time.perf_counter() - begun, app.screen.frames - frames  # type: ignore[attr-defined]
        found["fps"] = drawn / took_s
        found["cpu_share"] = (time.process_time() - cpu_s) / took_s
        found["cpu_ms_a_frame"] = 1e3 * (time.process_time() - cpu_s) / max(drawn, 1)
        app.exit()

    app.call_later(lambda: asyncio.create_task(watch()))
    app.run()
    said.write_text(json.dumps(found))


def figures_ms(recording: Path, columns: int, rows: int) -> float:
    """Six plots from the picture of a session to rows of characters, without a terminal."""
    from norton_bench.screen import figures  # noqa: PLC0415
    from norton_bench.screen.experiment import replayed  # noqa: PLC0415
    from norton_bench.screen.plots import Drawer  # noqa: PLC0415

    experiment = replayed(recording)
    experiment.seek(BEGIN_S + 20.0)
    experiment.update()
    picture, drawers = experiment.picture, [Drawer() for _ in range(6)]
    size = columns // 3, rows // 3
    begun, turns = time.process_time(), 20
    for _ in range(turns):
        shown = [make(picture, 10.0) for make in (figures.torque, figures.velocity, figures.command)]
        shown += [make(picture) for make in (figures.torque_velocity, figures.torque_position, figures.source)]
        for drawer, figure in zip(drawers, shown, strict=True):
            drawer.draw(figure, *size)
    return 1e3 * (time.process_time() - begun) / turns


def recorded(folder: Path) -> Path:
    """A standard session on the simulated bench."""
    from norton_bench.rig.load import load_rig  # noqa: PLC0415
    from norton_bench.session.engine import record_session  # noqa: PLC0415
    from norton_bench.session.schema import standard_session  # noqa: PLC0415

    rig = load_rig(Path(__file__).parents[1] / "rigs" / "sim-odrive.toml")
    return record_session(rig, standard_session(rig), out=folder, seed=1).recording


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recording", type=Path, help="replay this one instead of a session made for it")
    parser.add_argument("--seconds", type=float, default=20.0, help="for each size")
    parser.add_argument("--quick", action="store_true", help="two sizes, five seconds each")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    if CHILD in sys.argv:
        place, length, result, what = sys.argv[2:]
        child(Path(place), float(length), Path(result), stop=what == "stop")
    else:
        main()
