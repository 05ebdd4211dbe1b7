"""How late the loop is, beside cyclictest on the same CPU at the same time.

The host of a virtual machine freezes it now and then, so that a tail by itself measures the host. Here both suffer the
same freezes: cyclictest (Debian's rt-tests) at FIFO 90 and the loop at FIFO 80 share one CPU, window after window, and
their ratios are told as the median of the windows. The loop is a session's: two ODrive drives on udp_multicast and a
Bota sensor on a pseudo-terminal, served by ``sim serve`` on another CPU, a controller that imposes motion, the recorder
writing, and the screen of ``norton-bench ui`` redrawing, 25 times a second, what it replays. Where cyclictest is not
installed, a loop around clock_nanosleep stands in for it, and is called so. Beside the share of ticks run stands the
peer's share of its own: what both lack, the system took. As a bench has its CPU for itself, as many windows follow
with nobody beside the loop.

Beside it, where it is installed (PyPI: NeuroLocoMiddleware), a public peer in the loop's place: SoftRealtimeLoop with
nothing to do, at the same priority. Needs root, or the right to real-time priorities, and two CPUs. Run with
``python benchmarks/loop_lateness.py [--json] [--seconds 20] [--quick]``.
"""

import argparse
import json
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread
from typing import Any

import numpy as np
from lateness_peers import PEER_PRIORITY, PERCENTILES, SHARE, Cyclictest, Late, Nanosleep, Nobody, Peer, late
from screen import on_a_terminal, recorded

from norton_bench.errors import SafetyStopError
from norton_bench.loop.process import LoopProcess
from norton_bench.loop.timing import LoopTiming, loop_timing
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.excitations import imposed_multisine
from norton_bench.procedures.free import command_multisine
from norton_bench.procedures.knowledge import Knowledge
from norton_bench.procedures.options import CalibrateOptions, TareOptions
from norton_bench.procedures.tare import TareProcedure
from norton_bench.procedures.waves import imposed
from norton_bench.recording.recorder import Recorder
from norton_bench.records import Measured, Table
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use
from norton_bench.session.engine import record_procedures
from norton_bench.session.run import learned
from norton_bench.session.schema import Session
from norton_bench.session.warm_up import warm_up
from norton_drivers.real_time import LOOP_PRIORITY, permitted_priority

ROOT = Path(__file__).parents[1]
RIG_FILE = ROOT / "rigs" / "sim-odrive.toml"
WINDOWS, SECONDS, RATES_HZ = 5, 20.0, (1000, 2000)
QUICK_WINDOWS, QUICK_SECONDS, QUICK_RATES_HZ = 1, 4.0, (1000,)
# A host that freezes is to be measured, not to end the measurement.
PATIENT = {
    'stale_after = "100 ms"': 'stale_after = "1 s"',
    'stall_after = "100 ms"': 'stall_after = "1 s"',
    'watchdog = "300 ms"': 'watchdog = "2 s"',
}
MOTION_SHARE, COMMAND_SHARE = 0.1, 0.3
SETTLED_S = 0.5  # cyclictest, and the loop, are under way
# At 1 kHz: the ratios of lateness at most, the share of ticks at least, and a tick's work at most.
P99_RATIO, P999_RATIO, SHARE_RUN, WORK_P99_US = 0.8, 1.1, 0.99, 150.0
COLUMNS, ROWS = 160, 45
MOST_STOPPED = 5  # windows that the guard may end before something is wrong
REPLAY_S = 60.0  # less than there is to be replayed
CPU_S = 1 / os.sysconf("SC_CLK_TCK")


@dataclass
class Window:
    """One window: how late the loop was and its neighbour, and what the loop did."""

    loop: Late
    peer: Late
    timing: LoopTiming | None = None
    work_p99_us: float = 0.0

    def ratio(self, name: str) -> float:
        return self.loop[name] / max(self.peer[name], 1e-3)


@dataclass
class Found:
    """All windows of one loop at one rate."""

    who: str
    rate_hz: int
    peer: str
    windows: list[Window] = field(default_factory=list)
    alone: list[Window] = field(default_factory=list)
    stopped: int = 0  # windows that the guard ended, which are not among the others
    cpu_shares: Mapping[str, float] = field(default_factory=dict)

    def figures(self) -> dict[str, object]:
        def middle(of: Callable[[Window], float]) -> float:
            return float(np.median([of(window) for window in self.windows]))

        found: dict[str, object] = {"loop": self.who, "rate_hz": self.rate_hz, "peer": self.peer}
        found |= {"windows": len(self.windows), "stopped": self.stopped}
        for name in PERCENTILES:
            found[name] = {
                "loop_us": middle(lambda w, name=name: w.loop[name]),  # type: ignore[misc]
                "peer_us": middle(lambda w, name=name: w.peer[name]),  # type: ignore[misc]
                "ratio": middle(lambda w, name=name: w.ratio(name)),  # type: ignore[misc]
            }
        if any(window.timing is not None for window in self.windows):
            found["peers_share_run"] = middle(lambda w: w.peer[SHARE])
            found |= ticking(self.windows)
        if self.alone:
            late_us = {name: float(np.median([window.loop[name] for window in self.alone])) for name in PERCENTILES}
            found["alone"] = {"late_us": late_us, **ticking(self.alone)}
        if self.cpu_shares:
            found["cpu_shares"] = dict(self.cpu_shares)
        return found


def ticking(windows: list[Window]) -> dict[str, object]:
    """The share of ticks run, and what a tick works."""
    timings = [window.timing for window in windows if window.timing is not None]
    return {
        "share_run": sum(t.ticks for t in timings) / sum(t.ticks + t.skipped for t in timings),
        "work_p99_us": float(np.median([window.work_p99_us for window in windows])),
        "stages_p50_us": {
            stage: float(np.median([dict(t.stages)[stage].median_ns for t in timings])) * 1e-3
            for stage, _ in timings[0].stages
        },
    }


def main() -> int:
    """Returns 1 where a target is not reached."""
    arguments = _arguments()
    if arguments.neuroloco:
        return neuroloco(*arguments.neuroloco)
    if not permitted_priority(PEER_PRIORITY):
        print("this process may not take real-time priorities: run it as root", file=sys.stderr)
        return 2
    cpus = sorted(os.sched_getaffinity(0))
    if len(cpus) < 2:
        print("one CPU for the loop and another for its devices are needed", file=sys.stderr)
        return 2
    quick = arguments.quick
    seconds = arguments.seconds or (QUICK_SECONDS if quick else SECONDS)
    results = []
    for rate_hz in QUICK_RATES_HZ if quick else RATES_HZ:
        for found in measure(rate_hz, seconds, QUICK_WINDOWS if quick else WINDOWS, (cpus[-1], cpus[0])):
            results.append(found.figures())
            if not arguments.json:
                print(told(results[-1]), flush=True)
    missed = [miss for result in results for miss in misses(result)]
    if arguments.json:
        print(json.dumps({"results": results, "missed": missed}, indent=2))
    else:
        print("\n".join(missed) or "all targets reached")
    return 1 if missed else 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--json", action="store_true", help="figures as JSON")
    parser.add_argument("--seconds", type=float, help=f"of each window (default {SECONDS:g})")
    parser.add_argument("--quick", action="store_true", help="one short window at 1 kHz")
    parser.add_argument("--neuroloco", nargs=2, type=float, metavar=("HZ", "SECONDS"), help=argparse.SUPPRESS)
    return parser.parse_args()


def measure(rate_hz: int, seconds: float, windows: int, cpus: tuple[int, int]) -> Iterator[Found]:
    """The bench's own loop, then the public peer in its place; on ``cpus[0]``, with the devices on ``cpus[1]``."""
    warm_up()
    peer = Cyclictest() if shutil.which("cyclictest") else Nanosleep()
    with TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        rig = rig_of_its_own(folder, rate_hz)
        recording = recorded(folder)
        stack.enter_context(served(rig, cpus[1]))
        known = calibrated(rig, folder)
        stack.enter_context(redrawing(recording))
        yield own_loop(rig, known, folder, peer, seconds, windows, cpus[0])
        if found := public_loop(peer, rate_hz, seconds, windows, cpus[0]):
            yield found


def own_loop(rig: Rig, known: Knowledge, folder: Path, peer: "Peer", seconds: float, windows: int, cpu: int) -> Found:
    """Windows of imposed motion, recorded as a session's is."""
    rate_hz = round(1e9 / rig.tick_ns)
    found = Found("norton-bench", rate_hz, peer.name)
    with (
        LoopProcess(rig) as loop,
        Recorder(folder / f"{rate_hz}.mcap", rig_text=rig.text, metadata={}, patience_s=0.0) as recorder,
    ):
        os.sched_setaffinity(loop.pid, {cpu})
        loop.subscribe(recorder.put)
        loop.learn(learned(known))
        spent, began_s = cpu_times(loop, recorder), time.monotonic()
        for beside, into in ((peer, found.windows), (Nobody(), found.alone)):
            for number in range(windows):
                while (window := one_window(loop, known, number, beside, seconds, cpu)) is None:
                    found.stopped += 1
                    if found.stopped > MOST_STOPPED:
                        raise SystemExit("the guard stopped the bench again and again: see what is said above")
                into.append(window)
        elapsed_s = time.monotonic() - began_s
        found.cpu_shares = {who: (after - spent[who]) / elapsed_s for who, after in cpu_times(loop, recorder).items()}
    return found


def one_window(
    loop: LoopProcess, known: Knowledge, number: int, peer: "Peer", seconds: float, cpu: int
) -> Window | None:
    """None where the guard stopped the bench, which is said on standard error; it may then be enabled again."""
    tick_ns = known.rig.tick_ns
    segment = moving(known, seconds + 2 * SETTLED_S, number)
    with ExitStack() as stack:
        try:
            with loop.running():
                finish = stack.enter_context(peer.beside(round(1e9 / tick_ns), seconds, cpu))
                measured = loop.run(segment)
        except SafetyStopError as stop:
            print(f"window {number}, once more: {stop}", file=sys.stderr)
            loop.reset_guard("a benchmark on simulated devices goes on")
            return None
        return window_of(measured, finish(), tick_ns)


def window_of(measured: Measured, peer: Late, tick_ns: int) -> Window:
    settled = round(SETTLED_S * 1e9 / tick_ns)
    ticks = measured.ticks[settled:-settled]
    timing = loop_timing(ticks)
    assert timing is not None
    whole_us = (ticks["work_ns"][:-1] + ticks["put_ns"][1:]) * 1e-3
    return Window(lateness_of(ticks, tick_ns), peer, timing, float(np.percentile(whole_us, PERCENTILES["p99"])))


def lateness_of(ticks: Table, tick_ns: int) -> Late:
    """As cyclictest counts it: a stall is as long as it was, and one sample."""
    missed = np.concatenate(([0], np.diff(ticks["tick_ns"]) // tick_ns - 1))
    return late((ticks["lateness_ns"] + missed * tick_ns) * 1e-3, tick_ns * 1e-3)


def moving(known: Knowledge, seconds: float, seed: int) -> Segment:
    """Both drives at work, and the controller in between."""
    limit = COMMAND_SHARE * known.rig.command.limit
    motion = imposed_multisine(known, MOTION_SHARE, seconds, seed=seed)
    command = command_multisine(known, (-limit, limit), seconds, seed=seed + 100)
    return imposed("benchmark", f"window {seed}", Use.PREPARE, command, motion)


def public_loop(peer: Peer, rate_hz: int, seconds: float, windows: int, cpu: int) -> Found | None:
    """NeuroLoco's, where it is there."""
    try:
        import NeuroLocoMiddleware.SoftRealtimeLoop  # noqa: F401, PLC0415
    except ImportError:
        print("NeuroLocoMiddleware is not installed: no public peer", file=sys.stderr)
        return None
    found = Found("NeuroLoco's SoftRealtimeLoop", rate_hz, peer.name)
    for _ in range(windows):
        command = [sys.executable, __file__, "--neuroloco", str(rate_hz), str(seconds + 2 * SETTLED_S)]
        with subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            text=True,
            preexec_fn=partial(_as_the_loop, cpu),  # noqa: PLW1509  (no threads here)
        ) as process:
            assert process.stdout is not None
            process.stdout.readline()  # it is ready
            with peer.beside(rate_hz, seconds, cpu) as finish:
                beside = finish()
            found.windows.append(Window(json.loads(process.stdout.readlines()[-1]), beside))
    return found


def _as_the_loop(cpu: int) -> None:
    os.sched_setaffinity(0, {cpu})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(LOOP_PRIORITY))


def neuroloco(rate_hz: float, seconds: float) -> int:
    """In a process of its own: its loop with nothing to do; prints how late each round was against its own deadlines.

    Those it adds up from one to the next, as seconds since 1970: what that rounds away, 70 µs a second, is not held
    against it.
    """
    from NeuroLocoMiddleware.SoftRealtimeLoop import SoftRealtimeLoop  # noqa: PLC0415

    print("ready", flush=True)
    begun_s = np.empty(round(seconds * rate_hz))
    loop = SoftRealtimeLoop(dt=1 / rate_hz)
    for index, _ in enumerate(loop):
        begun_s[index] = time.time()
        if index + 1 == len(begun_s):
            break
    deadline_s = np.add.accumulate([loop.t0, *[1 / rate_hz] * (len(begun_s) - 1)])
    print(json.dumps(late((begun_s - deadline_s) * 1e6, 1e6 / rate_hz)))
    return 0


def rig_of_its_own(folder: Path, rate_hz: int) -> Rig:
    """On a group, a port and a pseudo-terminal that nobody else has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port = probe.getsockname()[1]
    text = RIG_FILE.read_text()
    own = {
        'rate = "1 kHz"': f'rate = "{rate_hz} Hz"',
        "239.74.163.2": "239.74.163.64",
        "socket://localhost:7641": str(folder / "bota"),
        'bitrate = "1 Mbit/s"': f'bitrate = "1 Mbit/s"\noptions = {{ port = {port} }}',
    }
    for right, other in {**PATIENT, **own}.items():
        assert right in text, right
        text = text.replace(right, other)
    (folder / "rig.toml").write_text(text)
    return load_rig(folder / "rig.toml", backend="hardware")


def calibrated(rig: Rig, folder: Path) -> Knowledge:
    """As it is served: in lock step its delays are others, with which motion could not be imposed for long."""
    steps = (TareProcedure(TareOptions()), CalibrateProcedure(CalibrateOptions()))
    return record_procedures(rig, Session((), "calibration"), steps, out=folder / "calibration").knowledge


@contextmanager
def served(rig: Rig, cpu: int) -> Iterator[None]:
    """The rig's devices, on another CPU than the loop's: on one, a loop in real time and its peer can lock each other
    out."""
    command = [sys.executable, "-m", "norton_bench", "sim", "serve", rig.place]
    with subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: os.sched_setaffinity(0, {cpu}),  # noqa: PLW1509  (no threads here)
    ) as server:
        assert server.stderr is not None
        try:
            if not (said := server.stderr.readline()).startswith("serving"):
                raise SystemExit(f"the simulated devices could not be served: {said}")
            yield
        finally:
            server.send_signal(signal.SIGINT)


@contextmanager
def redrawing(recording: Path) -> Iterator[None]:
    """The screen on a pseudo-terminal, playing ``recording`` back, again and again."""
    over = Event()
    command = [sys.executable, "-m", "norton_bench", "ui", "--replay", str(recording)]

    def redraw() -> None:
        while not over.is_set():
            screen, terminal = on_a_terminal(command, COLUMNS, ROWS)
            until_s = time.monotonic() + REPLAY_S
            while time.monotonic() < until_s and not over.is_set():
                if select.select([terminal], [], [], 0.1)[0]:
                    os.read(terminal, 1 << 16)
            screen.kill()
            screen.wait()
            os.close(terminal)

    thread = Thread(target=redraw)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def cpu_times(loop: LoopProcess, recorder: Recorder) -> dict[str, float]:
    """CPU time so far [s], by process."""

    def spent_s(pid: int) -> float:
        words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return (int(words[11]) + int(words[12])) * CPU_S

    return {"loop": spent_s(loop.pid), "session": spent_s(os.getpid()), "recorder": spent_s(recorder.writer_pid)}


def misses(result: Mapping[str, object]) -> list[str]:
    """The targets that a result of our own loop at 1 kHz does not reach."""
    if result["rate_hz"] != RATES_HZ[0] or "share_run" not in result:
        return []
    ratios = {name: result[name]["ratio"] for name in ("p99", "p99.9")}  # type: ignore[index]
    aims = (
        ("p99 ratio", ratios["p99"], ratios["p99"] <= P99_RATIO, f"at most {P99_RATIO}"),
        ("p99.9 ratio", ratios["p99.9"], ratios["p99.9"] <= P999_RATIO, f"at most {P999_RATIO}"),
        ("share of ticks run", result["share_run"], result["share_run"] >= SHARE_RUN, f"at least {SHARE_RUN}"),  # type: ignore[operator]
        ("work p99 [us]", result["work_p99_us"], result["work_p99_us"] <= WORK_P99_US, f"at most {WORK_P99_US:g}"),  # type: ignore[operator]
    )
    return [f"missed: {name} {value:.3g}, {aim}" for name, value, reached, aim in aims if not reached]


def told(result: Mapping[str, object]) -> str:
    """A result for people."""
    lines = [f"{result['loop']} at {result['rate_hz']} Hz beside {result['peer']}, {result['windows']} windows"]
    if result["stopped"]:
        lines.append(f"  the guard stopped {result['stopped']} more")
    for name in PERCENTILES:
        each: Mapping[str, float] = result[name]  # type: ignore[assignment]
        lines.append(
            f"  {name:>5}: {each['loop_us']:8.1f} us, peer {each['peer_us']:8.1f} us, ratio {each['ratio']:.2f}"
        )
    if "share_run" in result:
        shares = f"{100 * result['share_run']:.2f} %, of the peer's {100 * result['peers_share_run']:.2f} %"  # type: ignore[operator]
        lines.append(f"  ticks run {shares}, work p99 {result['work_p99_us']:.0f} us")
    if "alone" in result:
        alone: Mapping[str, Any] = result["alone"]  # type: ignore[assignment]
        late_us = ", ".join(f"{name} {value:.1f}" for name, value in alone["late_us"].items())
        lines.append(f"  with nobody beside it: late {late_us} us, ticks run {100 * alone['share_run']:.2f} %, ")
        lines[-1] += f"work p99 {alone['work_p99_us']:.0f} us"
    for key in ("stages_p50_us", "cpu_shares"):
        if key in result:
            items: Mapping[str, float] = result[key]  # type: ignore[assignment]
            lines.append(f"  {key}: " + ", ".join(f"{name} {value:.2g}" for name, value in items.items()))
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
