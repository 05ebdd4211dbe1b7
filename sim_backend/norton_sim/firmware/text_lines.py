"""What emulated devices make of lines of text on a serial line."""

from collections.abc import Callable
from functools import partial

from norton_sim.firmware.context import DeviceContext


class LineServer:
    """Hands ``process`` one line after the other, without its end: some time, up to ``jitter_ns`` and ``least_ns``,
    after it came, as a device that looks for them once in its loop. What is longer than ``longest`` is dropped."""

    def __init__(
        self, context: DeviceContext, process: Callable[[bytes], None], *, least_ns: int, jitter_ns: int, longest: int
    ) -> None:
        self._world = context.world
        self._random = context.random
        self._process = process
        self._least_ns, self._jitter_ns, self._longest = least_ns, jitter_ns, longest
        self._line = bytearray()
        self._free_ns = 0

    def receive(self, data: bytes) -> None:
        for byte in data:
            if byte in b"\r\n":
                wait_ns = self._least_ns + self._random.randrange(self._jitter_ns)
                self._free_ns = max(self._free_ns, self._world.now_ns + wait_ns)
                self._world.at(self._free_ns, partial(self._deal_with, bytes(self._line)))
                self._line.clear()
            else:
                self._line.append(byte)
                if len(self._line) >= self._longest:
                    self._line.clear()

    def _deal_with(self, line: bytes, _stamp_ns: int) -> None:
        if line:
            self._process(line)
