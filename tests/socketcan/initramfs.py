"""The first files of the emulated computer: enough to mount this machine's, and to start a program there."""

import shlex
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

_FILE, _FOLDER = 0o100755, 0o040755
_OPTIONS = "trans=virtio,version=9p2000.L,msize=512000"


def write_initramfs(to: Path, modules: Sequence[tuple[str, bytes]], results: Path, program: Sequence[str]) -> None:
    """With busybox, modules in the order in which they are loaded, and a script that changes over to the files."""
    files = [(f"modules/{number:02}-{name}", content) for number, (name, content) in enumerate(modules)]
    script = f"""#!/bin/busybox sh
for module in /modules/*; do /bin/busybox insmod $module; done
/bin/busybox mount -t 9p -o {_OPTIONS},ro,cache=loose machine /machine
/bin/busybox mount -t 9p -o {_OPTIONS} results /machine{shlex.quote(str(results))}
/bin/busybox mount -t devtmpfs dev /machine/dev
exec /bin/busybox switch_root /machine {shlex.join(program)}
"""
    busybox = Path(shutil.which("busybox") or "busybox").read_bytes()
    content = [("bin/busybox", busybox), ("init", script.encode()), *files]
    to.write_bytes(_archive([("bin", None), ("machine", None), ("modules", None), *content]))


def _archive(entries: Sequence[tuple[str, bytes | None]]) -> bytes:
    """As cpio's "newc" format, which Linux unpacks when it boots. Source: Linux, early-userspace/buffer-format."""
    return b"".join(
        part for number, entry in enumerate([*entries, ("TRAILER!!!", b"")]) for part in _entry(number, *entry)
    )


def _entry(number: int, name: str, content: bytes | None) -> Iterator[bytes]:
    mode, data, path = _FOLDER if content is None else _FILE, content or b"", name.encode() + b"\0"
    fields = (number, mode, 0, 0, 1, 0, len(data), 0, 0, 0, 0, len(path), 0)
    head = b"070701" + b"".join(b"%08X" % each for each in fields) + path
    yield head + bytes(-len(head) % 4)
    yield data + bytes(-len(data) % 4)
