"""How long served devices stood still, where real ones would have gone on: whether they or a loop were late."""

from dataclasses import dataclass, field

# Less does nobody harm: it is what a busy bus delays a frame by.
WORTH_TELLING_NS = 5_000_000


@dataclass
class Standstills:
    """Told each time the world goes on; ``count`` is how often it had stood still for longer than is worth telling."""

    longest_ns: int = field(default=0, init=False)
    count: int = field(default=0, init=False)
    _last_ns: int | None = field(default=None, init=False)

    def goes_on(self, now_ns: int) -> None:
        """At ``now_ns`` of the wall's clock."""
        if self._last_ns is not None:
            still_ns = now_ns - self._last_ns
            self.longest_ns = max(self.longest_ns, still_ns)
            self.count += still_ns > WORTH_TELLING_NS
        self._last_ns = now_ns

    def __str__(self) -> str:
        longest = f"the simulated devices stood still for {self.longest_ns / 1e6:.1f} ms at most"
        if not self.count:
            return longest
        times = "once" if self.count == 1 else f"{self.count} times"
        return f"{longest}, and for more than {WORTH_TELLING_NS / 1e6:g} ms {times}: real ones would have gone on"
