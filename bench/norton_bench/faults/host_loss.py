"""The host is lost, in wall time: its processes are killed or stopped by the operating system while the shaft moves.

One process serves the simulated devices on the rig's own ports, another is the host of a session on them. What is true
is read from the server's witness; stamps of both are of the machine's monotonic clock.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from norton_bench.faults.case import Allowed, Case, CaseResult, Detection, Verdict, judge, off_after_ns
from norton_bench.faults.rehearse import nothing_yet
from norton_bench.rig.rig import Rig
from norton_drivers.ports import TrueState

LONGEST_LINE = 200


# The file in which ``sim serve --witness`` writes what is true, read while it grows.
def read_witness(path: Path) -> list[TrueState]:
    """All whole lines so far; stamps are of the machine's monotonic clock."""
    return _states(path.read_bytes().split(b"\n")[1:])


def last_state(path: Path) -> TrueState | None:
    """The last whole line, without reading the others; None where there is none yet."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - 2 * LONGEST_LINE))
        # What stands before the first line end is the names of the columns, or half a line.
        states = _states(file.read().split(b"\n")[1:])
    return states[-1] if states else None


def _states(lines: list[bytes]) -> list[TrueState]:
    """What stands after the last line end may be half written."""
    return [_state(line.decode("ascii")) for line in lines[:-1]]


def _state(line: str) -> TrueState:
    stamp_ns, torque_nm, velocity_rad_s, load_velocity_rad_s, driving, armed = line.split(",")
    motion = (float(torque_nm), float(velocity_rad_s), float(load_velocity_rad_s))
    return TrueState(int(stamp_ns), *motion, _roles(driving), _roles(armed))


def _roles(joined: str) -> tuple[str, ...]:
    return tuple(joined.split("+")) if joined else ()


SIGNALS = {"host-killed": "SIGKILL", "host-stopped": "SIGSTOP"}

PROGRAM = (sys.executable, "-m", "norton_bench")
SESSION = """\
[[step]]
do = "tare"
duration = "500 ms"

[[step]]
do = "calibrate"
duration = "8 s"
"""
MOVING = 0.05  # of the velocity limit
MOVES_WITHIN_S = 120.0
LOOK_S = 0.005
STRIKES_WITHIN_S = 0.5
WATCH_ON_S = 0.3
END_WITHIN_S = 10.0
TRIES = 3


class _NoHostError(Exception):
    """The host ended by itself, or never moved anything; the text says why."""


class _CannotServeError(Exception):
    """This machine cannot serve the rig's devices; the text says why."""


def lose_host(rig: Rig, case: Case, allowed: Allowed, seed: int | None = None) -> CaseResult:
    """One such case; skipped, with the reason, where this machine cannot try it."""
    outcome = nothing_yet(rig, case, allowed)
    number = getattr(signal, SIGNALS[case.table["kind"]], None)
    if os.name != "posix" or number is None:
        return replace(outcome, verdict=Verdict.SKIPPED, guard="this operating system has no such signal")
    random, why = Random(seed), ""
    for _ in range(TRIES):
        try:
            states, begun_ns, took_ns = _strike(rig, number, allowed.ns, random)
            later = replace(allowed, ns=allowed.ns + took_ns)
            return _judged(replace(outcome, allowed_s=later.ns * 1e-9), states, begun_ns, rig, case, later)
        except _CannotServeError as reason:
            return replace(outcome, verdict=Verdict.SKIPPED, guard=str(reason))
        except _NoHostError as reason:  # a machine that is busy may stop a session by its stalls
            why = str(reason)
    return replace(outcome, guard=why)


def _strike(rig: Rig, number: int, allowed: int, random: Random) -> tuple[Sequence[TrueState], int, int]:
    """What was true, when the signal was sent, and how long that took [ns]: milliseconds on a busy computer."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        witness = folder / "witness.csv"
        with _served(rig, witness), _host(rig, folder) as host:
            _await_motion(rig, host, witness, folder)
            time.sleep(random.uniform(0, STRIKES_WITHIN_S))
            _await_motion(rig, host, witness, folder)  # it turns back and forth, and may just stand
            begun_ns = time.monotonic_ns()
            os.killpg(host.pid, number)  # the loop, the session and the identifier alike
            struck_ns = time.monotonic_ns()
            time.sleep(allowed * 1e-9 + WATCH_ON_S)
        return read_witness(witness), begun_ns, struck_ns - begun_ns


def _await_motion(rig: Rig, host: "subprocess.Popen[bytes]", witness: Path, folder: Path) -> None:
    deadline = time.monotonic() + MOVES_WITHIN_S
    while not _moves(last_state(witness), rig):
        if host.poll() is not None:
            raise _NoHostError(_last_words(folder))
        if time.monotonic() > deadline:
            raise _NoHostError(f"the shaft did not move within {MOVES_WITHIN_S:g} s")
        time.sleep(LOOK_S)


def _moves(state: TrueState | None, rig: Rig) -> bool:
    """Whether both drives drive, and turn the shaft."""
    if state is None:
        return False
    return len(state.driving) == 2 and abs(state.velocity_rad_s) > MOVING * rig.limits.velocity_rad_s


def _last_words(folder: Path) -> str:
    lines = (folder / "said").read_text(errors="replace").splitlines()
    return f"the host ended before it was lost: {lines[-1] if lines else 'without a word'}"


def _judged(
    outcome: CaseResult, states: Sequence[TrueState], begun_ns: int, rig: Rig, case: Case, allowed: Allowed
) -> CaseResult:
    off_ns = off_after_ns([state for state in states if state.stamp_ns >= begun_ns], begun_ns)
    detection = None if off_ns is None else Detection(begun_ns + off_ns, "the drives' own watchdogs")
    result = judge(states, begun_ns, detection, case, allowed=allowed, limits=rig.limits)
    if detection is None:
        return replace(outcome, **vars(result), guard="nothing stopped the drives")
    return replace(outcome, **vars(result), guard=detection.words, detected_s=result.off_s)


@contextmanager
def _served(rig: Rig, witness: Path) -> Iterator[None]:
    """The rig's devices, in a process of their own. Raises _CannotServeError."""
    command = [*PROGRAM, "sim", "serve", rig.place, "--witness", str(witness)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as server:
        assert server.stderr is not None
        log = server.stderr.readline()
        try:
            if not log.startswith("serving"):
                raise _CannotServeError(log.strip() or "the simulated devices could not be served")
            yield
        finally:
            _end(server)


def _end(server: "subprocess.Popen[str]") -> None:
    """As on a terminal; by force where that takes too long."""
    server.send_signal(signal.SIGINT)
    try:
        server.wait(END_WITHIN_S)
    except subprocess.TimeoutExpired:
        server.kill()


@contextmanager
def _host(rig: Rig, folder: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """A session on them, in a process group of its own, of which nothing is left afterwards."""
    (folder / "session.toml").write_text(SESSION)
    command = [*PROGRAM, "run", str(folder / "session.toml"), "--rig", rig.place, "--backend", "hardware"]
    with (
        (folder / "said").open("wb") as log,
        subprocess.Popen(
            [*command, "--out", str(folder / "out")], stdout=log, stderr=log, start_new_session=True
        ) as host,
    ):
        try:
            yield host
        finally:
            with suppress(ProcessLookupError):  # all of it ended by itself
                os.killpg(host.pid, signal.SIGKILL)
