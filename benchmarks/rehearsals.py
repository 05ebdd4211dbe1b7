"""How often a rehearsal on served devices is finished on a busy computer, why not where it is not, and what it found.

For every rig and run `norton-bench sim serve RIG` serves the simulated devices, and `norton-bench identify RIG
--backend hardware` meets them from another process, while other work keeps `--load` cores busy. One line for each run:
how the session ended, how late loop and simulated devices were, how many cores others used meanwhile, what the host of
a virtual machine took, and of the values how many were valid and how many of those have the true one in their 95 %
interval. Below it what the verdict calls inadequate. The program fails where less than 19 of 20 runs of a rig were
finished.

    python benchmarks/rehearsals.py [--rigs rigs/sim-odrive.toml rigs/sim-mit.toml] [--runs 20] [--load 1]
    python benchmarks/rehearsals.py --rigs rigs/sim-*.toml --runs 1 --load 0    # every rig in wall time: two hours

With `--ordinary-user` nothing may run in real time, as for a user without such rights.
"""

import argparse
import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO

from norton_bench.errors import UsageError
from norton_bench.loop.timing import LoopTiming, loop_timing
from norton_bench.models.parameters import HALF_INTERVAL, Status
from norton_bench.recording.reader import read_so_far
from norton_bench.rig.load import load_rig, true_parameters

ROOT = Path(__file__).parents[1]
RIGS = tuple(ROOT / "rigs" / f"sim-{name}.toml" for name in ("odrive", "cia402", "vesc", "mit"))
PROGRAM = (sys.executable, "-m", "norton_bench")
FINISHED_SHARE = 19 / 20
END_WITHIN_S = 10.0
# Linux' <linux/prctl.h> and <linux/capability.h>: what a process gives up for good, and the right to real time.
DROP_FROM_BOUNDING_SET, RIGHT_TO_REAL_TIME = 24, 23


@dataclass(frozen=True)
class Values:
    """How many values a session states, calls valid, and has right; and the verdict's words on what is inadequate."""

    stated: int = 0
    valid: int = 0
    held: int = 0
    inadequate: tuple[str, ...] = ()

    @classmethod
    def of(cls, result: str, true: Mapping[str, tuple[float, str]]) -> "Values":
        """Of what ``identify --json`` printed, beside the ``true`` values and their units; nothing where it failed."""
        if not result.strip():
            return cls()
        data = json.loads(result)
        valid = {name: each for name, each in data["parameters"].items() if each["status"] == Status.VALID.value}
        held = sum(
            abs(each["value"] - true[name][0]) <= HALF_INTERVAL * each["std"]
            for name, each in valid.items()
            if name in true
        )
        words = tuple(sentence for sentence in data["verdict"] if "inadequate" in sentence)
        return cls(len(data["parameters"]), len(valid), held, words)


@dataclass(frozen=True)
class Rehearsal:
    """One run. ``others`` is how many cores were busy with what is no part of it, on average.

    ``stolen_s`` is how long a virtual machine's host let a core stand still that wanted to run.
    """

    rig: str
    exit_code: int
    duration_s: float
    loop_late_p999_ms: float
    loop_late_most_ms: float
    skipped_share: float
    devices: str
    others: float
    stolen_s: float
    said: str
    values: Values = Values()

    @property
    def finished(self) -> bool:
        return self.exit_code == 0


def main() -> None:
    """Every run, printed; fails where one rig was finished too seldom."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", nargs="+", type=Path, default=RIGS)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--load", type=int, default=1, help="how many processes keep a core busy each")
    parser.add_argument("--ordinary-user", action="store_true", help="nothing may run in real time")
    parser.add_argument("--out", type=Path, help="keep recordings and what was said in this folder")
    asked = parser.parse_args()
    if asked.ordinary_user:
        _give_up_real_time()
    runs: list[Rehearsal] = []
    print(HEAD)
    for number in range(asked.runs):  # in turn, for what else the computer does comes and goes
        for rig in asked.rigs:
            with busy(asked.load), kept(asked.out, f"{rig.stem}-{number}") as folder:
                runs.append(rehearse(rig, folder))
            print(line(runs[-1]), flush=True)
    print("\n".join(summary(runs)))
    sys.exit(any(share < FINISHED_SHARE for share in finished(runs).values()))


def rehearse(rig: Path, folder: Path) -> Rehearsal:
    """One session on served devices; what it leaves is in ``folder``."""
    started_s, before = time.monotonic(), _busy_s()
    with (folder / "served.txt").open("w") as words, _program(["sim", "serve", str(rig)], words) as server:
        _await_words(folder / "served.txt", server)
        with (folder / "said.txt").open("w") as said, (folder / "result.json").open("w") as result:
            command = ["identify", str(rig), "--backend", "hardware", "--quiet", "--json", "--out", str(folder)]
            with _program(command, said, result) as host:
                exit_code = host.wait()
    duration_s, after = time.monotonic() - started_s, _busy_s()
    timing = _timing(folder)
    found = Rehearsal(
        rig.stem,
        exit_code,
        duration_s,
        timing.lateness.p999_ns * 1e-6 if timing else float("nan"),
        timing.lateness.most_ns * 1e-6 if timing else float("nan"),
        1.0 - timing.share_run if timing else float("nan"),
        _last_line(folder / "served.txt"),
        (after.all_s - before.all_s - (after.own_s - before.own_s)) / duration_s,
        after.stolen_s - before.stolen_s,
        "" if exit_code == 0 else _last_line(folder / "said.txt"),
        Values.of((folder / "result.json").read_text(), true_parameters(load_rig(rig))),
    )
    (folder / "rehearsal.json").write_text(json.dumps(asdict(found), indent=2))
    return found


@contextmanager
def busy(cores: int) -> Iterator[None]:
    """Inside, as many processes of ordinary priority never rest."""
    with ExitStack() as stack:
        for _ in range(cores):
            process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            stack.callback(process.wait)
            stack.callback(process.kill)
        yield


@contextmanager
def kept(out: Path | None, name: str) -> Iterator[Path]:
    """A folder that stays where ``out`` is told, and goes otherwise."""
    if out is None:
        with TemporaryDirectory() as folder:
            yield Path(folder)
        return
    (out / name).mkdir(parents=True)
    yield out / name


@contextmanager
def _program(
    arguments: Sequence[str], words: IO[str], result: IO[str] | None = None
) -> Iterator["subprocess.Popen[bytes]"]:
    """With its standard output in ``result``, or in ``words`` as its standard error is."""
    # Unbuffered: the last line is then what was written last, also where it went to standard error.
    process = subprocess.Popen(
        [*PROGRAM, *arguments], stdout=result or words, stderr=words, env={**os.environ, "PYTHONUNBUFFERED": "1"}
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(END_WITHIN_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _give_up_real_time() -> None:
    """For all that is started from here: root gives the right up, nobody else has it to give."""
    ctypes.CDLL(None).prctl(DROP_FROM_BOUNDING_SET, RIGHT_TO_REAL_TIME, 0, 0, 0)


def _await_words(words: Path, server: "subprocess.Popen[bytes]") -> None:
    while not words.read_text().startswith("serving"):
        if server.poll() is not None:
            sys.exit(_last_line(words))
        time.sleep(0.05)


def _timing(folder: Path) -> LoopTiming | None:
    """None where nothing was recorded."""
    try:
        return next(
            (loop_timing(read_so_far(path, raw_frames=False).measured.ticks) for path in folder.glob("*.mcap")), None
        )
    except UsageError:
        return None


def _last_line(path: Path) -> str:
    lines = path.read_text(errors="replace").split("\n")
    return next((text for text in reversed(lines) if text.strip()), "")


@dataclass(frozen=True)
class _Busy:
    """Processor time so far [s]: of the whole computer, of the children of this process that have ended, and stolen."""

    all_s: float
    own_s: float
    stolen_s: float


def _busy_s() -> _Busy:
    """Linux' /proc/stat: user, nice, system, idle, iowait, irq, softirq, steal in ticks."""
    ticks = [
        int(word) / os.sysconf("SC_CLK_TCK") for word in Path("/proc/stat").read_text().split("\n")[0].split()[1:9]
    ]
    user, nice, system, _, _, irq, softirq, stolen = ticks
    own = os.times()
    return _Busy(user + nice + system + irq + softirq, own.children_user + own.children_system, stolen)


HEAD = (
    f"{'rig':<14}{'ended':<10}{'[s]':>5}  {'late 99.9 %, most [ms]':<24}{'skipped':>8}  {'others':>6}  {'stolen':>6}  "
    f"{'valid, held':<13}devices; reason"
)


def line(run: Rehearsal) -> str:
    """One row under HEAD."""
    ended = "finished" if run.finished else f"exit {run.exit_code}"
    late = f"{run.loop_late_p999_ms:.2f}, {run.loop_late_most_ms:.1f}"
    row = f"{run.rig:<14}{ended:<10}{run.duration_s:>5.0f}  {late:<24}{100 * run.skipped_share:>6.2f} %"
    values = f"{run.values.valid}/{run.values.stated}, {run.values.held}"
    words = "; ".join(filter(None, (run.devices, run.said)))
    below = "".join(f"\n    {sentence}" for sentence in run.values.inadequate)
    return f"{row}  {run.others:>6.2f}  {run.stolen_s:>4.1f} s  {values:<13}{words}{below}"


def finished(runs: Sequence[Rehearsal]) -> dict[str, float]:
    """By rig, the share of its runs that were."""
    rigs = dict.fromkeys(run.rig for run in runs)
    return {
        rig: sum(run.finished for run in runs if run.rig == rig) / sum(run.rig == rig for run in runs) for rig in rigs
    }


def summary(runs: Sequence[Rehearsal]) -> Iterator[str]:
    """How many of each rig, and every reason with its count."""
    for rig in finished(runs):
        of_rig = [run for run in runs if run.rig == rig]
        yield f"{rig}: {sum(run.finished for run in of_rig)} of {len(of_rig)} finished"
    for said in dict.fromkeys(run.said for run in runs if run.said):
        yield f"{sum(run.said == said for run in runs)}: {said}"


if __name__ == "__main__":
    main()
