"""What a running session tells whoever watches it."""

from typing import Protocol

from bench.identification.results import LiveEstimate
from bench.records import Measured


class Progress(Protocol):
    """Receives the session's news; every method must return at once."""

    def plan(self, steps: tuple[tuple[str, float], ...]) -> None:
        """The steps ahead: name and expected duration [s of bench time]."""
        ...

    def step(self, index: int, name: str) -> None:
        """Step ``index`` begins."""
        ...

    def part(self, measured: Measured, live: LiveEstimate) -> None:
        """About 100 ms were measured, and this is what is known by now."""
        ...

    def note(self, text: str) -> None:
        """Something worth a line."""
        ...


class Silent:
    """Nobody watches."""

    def plan(self, steps: tuple[tuple[str, float], ...]) -> None: ...
    def step(self, index: int, name: str) -> None: ...
    def part(self, measured: Measured, live: LiveEstimate) -> None: ...
    def note(self, text: str) -> None: ...
