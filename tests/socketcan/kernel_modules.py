"""Modules of a Linux kernel, found by name under its folder, each after those that it depends on."""

import lzma
import re
from collections.abc import Iterator
from pathlib import Path

_DEPENDS = re.compile(rb"\0depends=([^\0]*)\0")


def in_order(folder: Path, *names: str) -> Iterator[tuple[str, bytes]]:
    """Name and content of each. Raises KeyError for a module that is not there; it may be built into the kernel."""
    files = {_plain(path.name.partition(".ko")[0]): path for path in folder.rglob("*.ko*")}
    loaded: set[str] = set()

    def with_needs(name: str) -> Iterator[tuple[str, bytes]]:
        if name in loaded:
            return
        loaded.add(name)
        path = files[name]
        content = lzma.decompress(path.read_bytes()) if path.suffix == ".xz" else path.read_bytes()
        needs = _DEPENDS.search(content)
        for need in (needs[1] if needs else b"").decode().split(","):
            if need:
                yield from with_needs(_plain(need))
        yield name, content

    for each in names:
        yield from with_needs(_plain(each))


def _plain(name: str) -> str:
    return name.replace("-", "_")
