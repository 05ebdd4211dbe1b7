"""Errors that end nothing, such as a message that cannot be decoded: drivers count them, the loop records them."""

from collections.abc import Callable
from dataclasses import dataclass, field

from norton_bench.loop.devices import Devices

LOOK_NS = 100_000_000
ASK_NS = 1_000_000_000
# The same error is recorded at most so often: some come with every frame.
REPEAT_NS = 1_000_000_000
# What a driver counts, under what name, if it counts.
COUNTED = {"malformed": "messages that could not be decoded", "repeats": "messages that repeat a sample"}

# Where and what, and how often since the port was opened.
Counts = dict[tuple[str, str], int]


def troubles_of(devices: Devices) -> Counts:
    """All that buses, adapters and drivers have counted."""
    counts = devices.link.troubles()
    for device in devices.all():
        for name, what in COUNTED.items():
            if count := getattr(device, name, 0):
                counts[f"[{device.role}]", what] = count
    return counts


@dataclass
class TroubleLog:
    """Compares the counts with those before, ten times a second; ``put(stamp_ns, kind, text)`` gets what has grown.

    :meth:`look` is to be called when ``due_ns`` has come.
    """

    devices: Devices
    put: Callable[[int, str, str], None]
    due_ns: int = field(default=0, init=False)
    _recorded: Counts = field(default_factory=dict, init=False)
    _recorded_ns: dict[tuple[str, str], int] = field(default_factory=dict, init=False)
    _ask_ns: int = field(default=0, init=False)

    def begin(self, now_ns: int) -> None:
        """What was counted before is not recorded."""
        self._recorded = troubles_of(self.devices)
        self.due_ns, self._ask_ns = now_ns + LOOK_NS, now_ns

    def look(self, now_ns: int) -> None:
        """Record what has grown. Raises ConnectionFailedError for a lost bus."""
        self.due_ns = now_ns + LOOK_NS
        if now_ns >= self._ask_ns:
            self._ask_ns = now_ns + ASK_NS
            self.devices.link.ask_adapters()
        self._record(now_ns, now_ns - REPEAT_NS)

    def end(self, now_ns: int) -> None:
        """Record what has grown since the last time."""
        self._record(now_ns, now_ns)

    def _record(self, now_ns: int, latest_ns: int) -> None:
        """Put what has grown and was put at ``latest_ns`` or before, or never."""
        for key, count in troubles_of(self.devices).items():
            before = self._recorded.get(key, 0)
            if count > before and self._recorded_ns.get(key, latest_ns) <= latest_ns:
                self._recorded[key], self._recorded_ns[key] = count, now_ns
                self.put(now_ns, "bus" if key[0].startswith("bus ") else "device", _sentence(key, before, count))


def _sentence(key: tuple[str, str], before: int, count: int) -> str:
    place, what = key
    more = count - before
    times = "once" if more == 1 else f"{more} times"
    return f"{place}: {what}, {times}" + (f" more ({count} in all)" if before else "")
