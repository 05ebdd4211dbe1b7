"""What SIGKILL costs: the recording process or the whole program is killed at random moments of sessions in wall time.

    python benchmarks/kill_recording.py --kills 100 [--json] [--seed N]

One simulated bench is served on real interfaces; sessions run on it one after the other, and each is killed within its
first seconds. Every other kill hits the recording process alone, the others all processes of the program at once.
Afterwards the recording is recovered, and compared with two witnesses that were not killed: a listener on the bus that
knows nothing of this program but its port, and a file to which the session gave the same parts as to the recorder.

Lost is what was commanded on the bus between the last tick in the recovered recording and the kill, a tick a
millisecond; the commands by which drives are enabled and stopped count as lost too, though they are no ticks.
A row is wrong where it differs from the witness's, a frame where it differs from what was heard.
Source of the packets' format: python-can, interfaces/udp_multicast/utils.py.
"""

import argparse
import json
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from typing import Any

import msgpack
import numpy as np

from norton_bench.errors import BenchError, ExperimentError
from norton_bench.events import PartMeasured, SessionEvent
from norton_bench.procedures.options import CalibrateOptions, TareOptions
from norton_bench.recording import wire
from norton_bench.recording.frames import log_name
from norton_bench.recording.reader import read_recording
from norton_bench.recording.recover import recover
from norton_bench.records import TABLES, Measured
from norton_bench.rig.load import load_rig
from norton_bench.session.engine import record_session
from norton_bench.session.schema import Session, Step
from norton_drivers.codecs.odrive import MessageId
from norton_drivers.readings import RawFrame

ROOT = Path(__file__).parents[1]
GROUP = "239.74.163.63"
SESSION = Session(
    (Step("tare", TareOptions(duration_s=0.5)), Step("calibrate", CalibrateOptions(duration_s=4.0))), place="kills"
)
LATEST_S = 4.0  # after the first part, at which a kill comes
ALLOWED_MS = 150.0
# A host that is no real-time machine may stand still for tens of milliseconds.
PATIENT = {
    'stale_after = "100 ms"': 'stale_after = "250 ms"',
    'stall_after = "100 ms"': 'stall_after = "200 ms"',
    'watchdog = "300 ms"': 'watchdog = "400 ms"',
}
TOLD_WITHIN_S = 120.0
COMMANDS_A_TICK, TICK_MS = 2, 1.0
COMMAND_BITS = 0x1F  # of an ODrive's identifier; the node stands above them


@dataclass(frozen=True)
class Kill:
    """One kill. ``stopped_ms`` is from the kill to the last command on the bus: so long the drives were driven on."""

    of: str
    lost_ms: float
    ticks: int
    wrong_rows: int
    wrong_frames: int
    recovered: bool
    stopped_ms: float


# ---- the program that is killed ----------------------------------------------------------------------------------


class Witness:
    """Puts every part into a file of its own, in one write; says when the first one has come."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=0)
        self._parts = 0

    def __call__(self, event: SessionEvent) -> None:
        if not isinstance(event, PartMeasured):
            return
        measured = event.measured
        if not self._parts and len(measured.ticks):
            print("measuring", flush=True)
        self._parts += bool(len(measured.ticks))
        wire.send(self._file, wire.part_of(measured))


def program(folder: Path) -> None:
    """Runs a session for every line on standard input, which names it, and says how it ended."""
    rig = load_rig(folder / "rig.toml", backend="hardware")
    for line in sys.stdin:
        name = line.strip()
        try:
            record_session(rig, SESSION, out=folder / name, on_event=Witness(folder / f"{name}.witness"))
        except BenchError as error:
            print(f"ended: {error}", flush=True)
        else:
            print("ended: at its end", flush=True)


# ---- the witness on the bus --------------------------------------------------------------------------------------


class Listener:
    """Hears every packet on the bus, with the monotonic clock's time; decodes none before it is asked."""

    def __init__(self, port: int) -> None:
        self.heard: list[tuple[int, bytes]] = []
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self._socket.bind((GROUP, port))
        request = struct.pack("4sl", socket.inet_aton(GROUP), socket.INADDR_ANY)
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, request)
        Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        while True:
            packet = self._socket.recv(2048)
            self.heard.append((time.monotonic_ns(), packet))

    def commands(self) -> list[tuple[int, int, bytes]]:
        """Time [ns], identifier and data of every torque command since it was last asked."""
        heard, self.heard = self.heard, []
        messages = ((stamp_ns, msgpack.unpackb(packet, raw=False)) for stamp_ns, packet in heard)
        return [
            (stamp_ns, message["arbitration_id"], message["data"])
            for stamp_ns, message in messages
            if is_torque(message["arbitration_id"])
        ]


def is_torque(arbitration_id: int) -> bool:
    return arbitration_id & COMMAND_BITS == MessageId.SET_INPUT_TORQUE


# ---- kills -------------------------------------------------------------------------------------------------------


def unused_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])


@contextmanager
def served(folder: Path, port: int) -> Iterator[None]:
    """The rig on a group, a port and a pseudo-terminal of its own."""
    text = (ROOT / "rigs" / "sim-odrive.toml").read_text()
    own = {
        "239.74.163.2": GROUP,
        "socket://localhost:7641": str(folder / "bota"),
        'bitrate = "1 Mbit/s"': f'bitrate = "1 Mbit/s"\noptions = {{ port = {port} }}',
    }
    for right, other in {**PATIENT, **own}.items():
        text = text.replace(right, other)
    (folder / "rig.toml").write_text(text)
    command = [sys.executable, "-m", "norton_bench", "sim", "serve", "rig.toml"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("serving")
        try:
            yield
        finally:
            process.send_signal(signal.SIGINT)


class Program:
    """The program in processes of its own. Raises ExperimentError where it does not say what is waited for."""

    def __init__(self, folder: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--program", str(folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        self._lines: Queue[str] = Queue()
        Thread(target=self._listen, daemon=True).start()

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def begin(self, name: str) -> None:
        """Start a session, and wait until it measures."""
        assert self._process.stdin is not None
        print(name, file=self._process.stdin, flush=True)
        if (said := self.said()) != "measuring":
            raise ExperimentError(f"session {name} did not begin: {said}")

    def said(self) -> str:
        """What it says next."""
        try:
            return self._lines.get(timeout=TOLD_WITHIN_S)
        except Empty:
            raise ExperimentError(f"the program has said nothing for {TOLD_WITHIN_S:.0f} s") from None

    def kill_recorder(self) -> None:
        for pid in self._recorders():
            os.kill(pid, signal.SIGKILL)

    def kill(self) -> None:
        """All of it, the recording process first: so nobody is left who could write the rest."""
        recorders = self._recorders()
        for pid in (*recorders, *(pid for pid in self._all() if pid not in recorders)):
            with suppress(ProcessLookupError):  # one that ended with its parent
                os.kill(pid, signal.SIGKILL)
        self._process.wait()

    def end(self) -> None:
        """Let it end by itself."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.strip())

    def _recorders(self) -> list[int]:
        program = b"norton_bench.recording.writer"
        return [pid for pid in self._all() if program in Path(f"/proc/{pid}/cmdline").read_bytes()]

    def _all(self) -> list[int]:
        found, parents = [self._process.pid], parents_of_all()
        for pid in found:
            found += [child for child, parent in parents.items() if parent == pid]
        return found


def parents_of_all() -> dict[int, int]:
    """Every process and its parent."""
    found = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            found[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
    return found


def one(folder: Path, program: Program, listener: Listener, name: str, of: str, after_s: float) -> Kill:
    listener.commands()
    program.begin(name)
    time.sleep(after_s)
    killed_ns = time.monotonic_ns()
    if of == "recorder":
        program.kill_recorder()
        if "broke down" not in (said := program.said()):
            raise ExperimentError(f"session {name} {said}")
    else:
        program.kill()
    time.sleep(0.1)
    return judged(folder, name, of, killed_ns, listener.commands())


def judged(folder: Path, name: str, of: str, killed_ns: int, heard: list[tuple[int, int, bytes]]) -> Kill:
    """What is left of the session, against its witnesses."""
    last_ns = max((stamp_ns for stamp_ns, *_ in heard), default=killed_ns)
    path = folder / name / "sim-odrive.mcap"
    try:
        report = recover(path)
        kept = read_recording(report.path).measured
        lines = log_name(report.path).read_text().count("\n")
    except BenchError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return Kill(of, float("inf"), 0, 0, 0, False, float("nan"))
    return Kill(
        of=of,
        lost_ms=lost_ms(heard, int(kept.ticks["tick_ns"][-1]), killed_ns),
        ticks=len(kept.ticks),
        wrong_rows=wrong_rows(kept, folder / f"{name}.witness"),
        wrong_frames=wrong_frames(kept.frames, heard),
        recovered=lines == sum(frame.arbitration_id >= 0 for frame in kept.frames),
        stopped_ms=max(last_ns - killed_ns, 0) * 1e-6,
    )


def lost_ms(heard: list[tuple[int, int, bytes]], kept_ns: int, killed_ns: int) -> float:
    """As many ticks as had their commands on the bus between the last one kept and the kill."""
    after = sum(kept_ns + TICK_MS * 1e6 <= stamp_ns < killed_ns for stamp_ns, *_ in heard)
    return after / COMMANDS_A_TICK * TICK_MS


def wrong_rows(kept: Measured, witness: Path) -> int:
    """How many rows differ from the witness's, as far as both go. Raises ExperimentError where there is nothing."""
    parts = []
    with witness.open("rb") as file:
        while isinstance(part := wire.receive(file), wire.Part):
            parts.append(part)
    wrong = 0
    for stream in TABLES:
        theirs = np.frombuffer(b"".join(part.tables.get(stream.name, b"") for part in parts), stream.kind.columns)
        ours = getattr(kept, stream.name)
        common = min(len(ours), len(theirs))
        if not common and stream.name == "ticks":
            raise ExperimentError(f"{witness} and the recording have no tick in common")
        wrong += sum(a.tobytes() != b.tobytes() for a, b in zip(ours[:common], theirs[:common], strict=True))
    return wrong


def wrong_frames(kept: tuple[RawFrame, ...], heard: list[tuple[int, int, bytes]]) -> int:
    """How many recorded torque commands were not heard on the bus in this order.

    What was heard besides does not count: it came after the last row.
    """
    sent = [(frame.arbitration_id, frame.data) for frame in kept if frame.sent and is_torque(frame.arbitration_id)]
    rest = iter([(identifier, bytes(data)) for _, identifier, data in heard])
    return sum(command not in rest for command in sent)


# ---- results -----------------------------------------------------------------------------------------------------


def summary(kills: list[Kill], ended_early: int) -> dict[str, Any]:
    lost = [one.lost_ms for one in kills]
    return {
        "kills": len(kills),
        "recovered": sum(one.recovered for one in kills),
        "lost_ms": {"median": float(np.median(lost)), "max": max(lost), "allowed": ALLOWED_MS},
        "lost_ms_of": {
            of: {"kills": len(own), "median": float(np.median(own)), "max": max(own)}
            for of in ("recorder", "program")
            if (own := [one.lost_ms for one in kills if one.of == of])
        },
        "ticks": sum(one.ticks for one in kills),
        "wrong_rows": sum(one.wrong_rows for one in kills),
        "wrong_frames": sum(one.wrong_frames for one in kills),
        "stopped_ms_after_recorder": max((one.stopped_ms for one in kills if one.of == "recorder"), default=None),
        "ended_before_the_kill": ended_early,
        "held": all(one.recovered and one.lost_ms <= ALLOWED_MS and not one.wrong_rows for one in kills),
    }


def told(found: dict[str, Any]) -> str:
    lines = [
        f"{found['kills']} kills, {found['recovered']} recovered, {found['ticks']} ticks kept, "
        f"{found['wrong_rows']} wrong rows, {found['wrong_frames']} wrong frames",
        f"lost: {found['lost_ms']['median']:.0f} ms median, {found['lost_ms']['max']:.0f} ms at most "
        f"({ALLOWED_MS:.0f} allowed)",
    ]
    lines += [
        f"  {of}: {own['kills']} kills, {own['median']:.0f} ms median, {own['max']:.0f} ms at most"
        for of, own in found["lost_ms_of"].items()
    ]
    return "\n".join(lines)


def run(kills: int, seed: int) -> tuple[list[Kill], int]:
    """The kills, and how many sessions ended before theirs."""
    chance, done, early = random.Random(seed), list[Kill](), 0
    with tempfile.TemporaryDirectory(dir="/tmp") as name:
        folder, port = Path(name), unused_port()
        listener = Listener(port)
        with served(folder, port):
            program = Program(folder)
            while len(done) < kills:
                # In runs of ten: for every kill of its own, the program has to be started anew.
                of = ("recorder", "program")[len(done) // 10 % 2]
                program = program if program.running else Program(folder)
                try:
                    session = f"s{len(done)}-{early}"
                    done.append(one(folder, program, listener, session, of, chance.uniform(0, LATEST_S)))
                except ExperimentError as error:
                    program.kill()  # what it would say next is of this session
                    early += 1
                    print(f"not counted: {error}", file=sys.stderr)
                    if early > kills:
                        raise
                else:
                    print(json.dumps(asdict(done[-1])), file=sys.stderr)
            if program.running:
                program.end()
    return done, early


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--program", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.program is not None:
        program(asked.program)
        return 0
    found = summary(*run(asked.kills, asked.seed))
    print(json.dumps(found, indent=2) if asked.json else told(found))
    return 0 if found["held"] else 1


if __name__ == "__main__":
    sys.exit(main())
