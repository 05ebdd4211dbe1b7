"""What goes wrong now and then without ending anything: counted where it happens, told as events."""

from collections.abc import Callable
from dataclasses import dataclass, field

from norton_bench.loop.devices import Devices

LOOK_NS = 100_000_000
ASK_NS = 1_000_000_000
# The same trouble is told at most so often: some come with every frame.
TELL_NS = 1_000_000_000
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
    """Looks at the counts now and then, and hands what has grown to ``tell(stamp_ns, kind, text)``."""

    devices: Devices
    tell: Callable[[int, str, str], None]
    _told: Counts = field(default_factory=dict, init=False)
    _told_ns: dict[tuple[str, str], int] = field(default_factory=dict, init=False)
    _look_ns: int = field(default=0, init=False)
    _ask_ns: int = field(default=0, init=False)

    def begin(self, now_ns: int) -> None:
        """What was there before is no news."""
        self._told = troubles_of(self.devices)
        self._look_ns, self._ask_ns = now_ns + LOOK_NS, now_ns

    def look(self, now_ns: int) -> None:
        """Called every tick; does something ten times a second. Raises ConnectionFailedError for a lost bus."""
        if now_ns < self._look_ns:
            return
        self._look_ns = now_ns + LOOK_NS
        if now_ns >= self._ask_ns:
            self._ask_ns = now_ns + ASK_NS
            self.devices.link.ask_adapters()
        self._tell_news(now_ns, now_ns - TELL_NS)

    def end(self, now_ns: int) -> None:
        """Tell what has not been told yet."""
        self._tell_news(now_ns, now_ns)

    def _tell_news(self, now_ns: int, told_before_ns: int) -> None:
        for key, count in troubles_of(self.devices).items():
            before = self._told.get(key, 0)
            if count > before and self._told_ns.get(key, told_before_ns) <= told_before_ns:
                self._told[key], self._told_ns[key] = count, now_ns
                self.tell(now_ns, "bus" if key[0].startswith("bus ") else "device", _sentence(key, before, count))


def _sentence(key: tuple[str, str], before: int, count: int) -> str:
    place, what = key
    news = count - before
    times = "once" if news == 1 else f"{news} times"
    return f"{place}: {what}, {times}" + (f" more ({count} in all)" if before else "")
