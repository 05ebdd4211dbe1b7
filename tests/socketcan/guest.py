"""The first program inside the guest: mounts, loads the kernel's CAN, carries out one part, writes what it saw, ends.

``guest.py PART CHECKOUT RESULTS FOLDER MODULE,MODULE`` and what the kernel adds. Each line of RESULTS is one thing that
was looked at. The host's files are read-only, but for the checkout under User-mode Linux, whose processor is the host's
and may use the same compiled code, and for the folder of results under QEMU.
"""

import ctypes
import errno
import importlib
import json
import os
import subprocess
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

from kernel_modules import in_order

WORK = Path("/run")  # a file system in memory
READ_WRITE, POWER_OFF, INIT_MODULE = 0, 0x4321FEDC, 175  # <linux/reboot.h>; the system call's number on x86-64
LIBC = ctypes.CDLL(None, use_errno=True)

Tell = Callable[[str, bool, str], None]


def mount(source: str, target: str, kind: str, options: str = "") -> None:
    Path(target).mkdir(parents=True, exist_ok=True)
    done = LIBC.mount(source.encode(), target.encode(), kind.encode(), READ_WRITE, options.encode())
    if done and ctypes.get_errno() != errno.EBUSY:  # somebody has mounted it already
        raise OSError(ctypes.get_errno(), f"cannot mount {kind} on {target}")


def load_modules(folder: str, names: str) -> None:
    """Of User-mode Linux; under QEMU all are loaded."""
    for name, content in in_order(Path(folder), *filter(None, names.split(","))):
        if LIBC.syscall(INIT_MODULE, content, len(content), b"") and ctypes.get_errno() != errno.EEXIST:
            raise OSError(ctypes.get_errno(), f"cannot load {name}")


def main(part: str, checkout: str, results: str, folder: str, modules: str, *_: str) -> None:
    for source, target, kind in (
        ("proc", "/proc", "proc"),
        ("sys", "/sys", "sysfs"),
        ("run", "/run", "tmpfs"),
        ("shm", "/dev/shm", "tmpfs"),
        ("pts", "/dev/pts", "devpts"),
    ):
        mount(source, target, kind, "ptmxmode=666" if kind == "devpts" else "")
    if "hostfs" in Path("/proc/mounts").read_text():  # User-mode Linux; under QEMU it is mounted before
        mount("none", checkout, "hostfs", checkout)
    os.environ.update(PATH="/usr/sbin:/usr/bin:/sbin:/bin", HOME="/run", TMPDIR="/run", TERM="dumb")
    load_modules(folder, modules)
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    # Linux keeps a twentieth of each second from what runs in real time, and here nothing else makes the clock pass.
    Path("/proc/sys/kernel/sched_rt_runtime_us").write_text("-1")
    os.chdir(WORK)
    with Path(results).open("a", encoding="utf-8") as file:

        def tell(what: str, ok: bool, seen: str) -> None:
            file.write(json.dumps({"what": what, "ok": ok, "seen": seen}) + "\n")
            file.flush()

        name, _, argument = part.partition(":")
        try:
            importlib.import_module(name).run(Path(checkout), argument, tell)
            tell("end", True, f"of {part}")
        except Exception:
            tell(part, False, traceback.format_exc())


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except Exception:
        traceback.print_exc()
    os.sync()
    LIBC.reboot(POWER_OFF)
