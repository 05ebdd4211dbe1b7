"""`make socketcan`: this program on the CAN sockets and drivers of real Linux kernels, on a machine that has none.

Two kernels of Debian run as ordinary programs, without root rights, and see this machine's files. User-mode Linux runs
at the processor's own speed: whole sessions of four families of drives, over `vcan`. QEMU emulates a computer with two
CAN controllers on one bus, which its kernel's `kvaser_pci` drives: links that are down, slow, full or out of order.
Nothing is said of time. Prints what was seen; the exit code is 1 where something was not as it should be.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from initramfs import write_initramfs
from kernel_modules import in_order

from norton_bench.session.warm_up import warm_up
from sessions import write_truth

HERE = Path(__file__).resolve().parent
CHECKOUT = HERE.parents[1]
OUT = CHECKOUT / "runs/socketcan"
# Where Debian's packages are: on this machine, or unpacked elsewhere with `dpkg-deb -x PACKAGE.deb FOLDER`.
ROOT = Path(os.environ.get("KERNELS", "/"))
FAMILIES = ("odrive", "cia402", "vesc", "mit")
AT_MOST_S = 1200.0  # on a machine that is busy with other things


@dataclass(frozen=True)
class Guest:
    """A kernel that carries out one part and ends; it leaves what it saw, and its console, in files."""

    part: str
    command: Sequence[str]
    environment: dict[str, str] = field(default_factory=dict)

    def run(self) -> list[dict[str, object]]:
        """What was seen, the last of it whether the part came to its end."""
        with self.file("console").open("wb") as console, self.file("json").open("w"):
            guest = subprocess.Popen(
                self.command,
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=console,
                env=os.environ | self.environment,
            )
            try:
                guest.wait(AT_MOST_S)
            except subprocess.TimeoutExpired:
                guest.kill()
                guest.wait()
        seen = [json.loads(line) for line in self.file("json").read_text(encoding="utf-8").splitlines()]
        if not seen or seen[-1]["what"] != "end":
            seen.append({"what": self.part, "ok": False, "seen": f"did not end; see {self.file('console')}"})
        return seen

    def file(self, kind: str) -> Path:
        return file_of(self.part, kind)


def file_of(part: str, kind: str) -> Path:
    return OUT / f"{part.replace(':', '-')}.{kind}"


def first_program(part: str, folder: Path, modules: str = "") -> list[str]:
    """The arguments of the guest's first program, which is this Python; it loads the modules."""
    return [str(HERE / "guest.py"), part, str(CHECKOUT), str(file_of(part, "json")), str(folder), modules]


# ---- User-mode Linux ------------------------------------------------------------------------------------------------


def sessions() -> Iterator[Guest]:
    """A guest for each family."""
    kernel = ROOT / "usr/bin/linux.uml"
    folder = next((ROOT / "usr/lib/uml/modules").iterdir())
    clock = OUT / "guest_clock.so"
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", clock, HERE / "guest_clock.c"], check=True)
    for family in FAMILIES:
        part = f"sessions:{family}"
        write_truth(CHECKOUT, family, OUT)
        command = [
            *(str(kernel), "mem=2G", "rootfstype=hostfs", "ro", "quiet", "con=null", "con0=fd:0,fd:1"),
            *("lpj=20000000", f"init={sys.executable}", "--"),  # the clock does not let Linux measure its own speed
            *first_program(part, folder, "can_raw,vcan"),
        ]
        yield Guest(part, command, {"LD_PRELOAD": str(clock)})


# ---- QEMU -----------------------------------------------------------------------------------------------------------


def kernels() -> Iterator[tuple[Path, Path]]:
    """Each kernel that has what is needed, the newest first, and the folder of its modules."""
    for kernel in sorted(ROOT.glob("boot/vmlinuz-*"), reverse=True):
        folder = ROOT / "lib/modules" / kernel.name.partition("-")[2]
        if list(folder.rglob("kvaser_pci.ko*")) and list(folder.rglob("9pnet_virtio.ko*")):
            yield kernel, folder


def controllers() -> Iterator[Guest]:
    """One guest, with two controllers on one bus; emulated without KVM, which does not run inside every machine."""
    kernel, folder = next(kernels())
    start, part = OUT / "initramfs", "links"
    modules = list(
        in_order(folder, "virtio_pci", "9pnet_virtio", "9p", "can_raw", "can_bcm", "kvaser_pci", "vcan", "sch_tbf")
    )
    write_initramfs(start, modules, OUT, [sys.executable, *first_program(part, folder)])
    share = "local,security_model=none,multidevs=remap"
    command = [
        *("qemu-system-x86_64", "-accel", "tcg,thread=single", "-smp", "2", "-m", "2G", "-cpu", "max"),
        *("-display", "none", "-serial", "stdio", "-monitor", "none", "-no-reboot", "-nic", "none"),
        *("-kernel", str(kernel), "-initrd", str(start)),
        *("-append", "console=ttyS0 quiet panic=-1 threadirqs mitigations=off"),
        *("-virtfs", f"{share},path=/,mount_tag=machine,readonly=on"),
        *("-virtfs", f"{share},path={OUT},mount_tag=results"),
        *("-object", "can-bus,id=bus", "-device", "kvaser_pci,canbus=bus", "-device", "kvaser_pci,canbus=bus"),
    ]
    yield Guest(part, command)


def missing() -> Iterator[str]:
    """Debian's packages that are needed and not there."""
    if not (ROOT / "usr/bin/linux.uml").exists():
        yield "user-mode-linux"
    if next(kernels(), None) is None:
        yield "linux-image-amd64"
    for program, package in (
        ("qemu-system-x86_64", "qemu-system-x86"),
        ("busybox", "busybox-static"),
        ("cc", "gcc"),
        ("ip", "iproute2"),
    ):
        if shutil.which(program) is None:
            yield package


def a_core_each(guests: Iterator[Guest]) -> Iterator[list[dict[str, object]]]:
    """What each has seen. User-mode Linux is two processes that take turns at each system call, which takes twice the
    time on two cores."""
    free = iter(cores := sorted(os.sched_getaffinity(0)))
    with ThreadPoolExecutor(len(cores), initializer=lambda: os.sched_setaffinity(0, {next(free)})) as pool:
        yield from pool.map(Guest.run, guests)


def main() -> int:
    if lacking := list(missing()):
        print(f"make socketcan: skipped; it needs `sudo apt-get install {' '.join(lacking)}`")
        return 0
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    warm_up()
    begun_s, wrong = time.monotonic(), 0
    for seen in a_core_each(chain(controllers(), sessions())):
        for each in seen:
            wrong += not each["ok"]
            print(f"{'ok   ' if each['ok'] else 'WRONG'}  {each['what']:44} {each['seen']}", flush=True)
    print(f"{wrong or 'nothing'} was not as it should be; {time.monotonic() - begun_s:.0f} s")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
