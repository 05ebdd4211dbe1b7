"""The bench moved by hand in another process than the screen. Quick to import: the screen imports only this."""

from dataclasses import dataclass
from pathlib import Path

from norton_bench.events import Watcher
from norton_bench.jog.hands import DEAD_MAN_S, Board, bounds_of
from norton_bench.rig.rig import Rig
from norton_bench.session.operator import Operator


@dataclass(frozen=True)
class Jog:
    """Runs in a process of its own (a :class:`~norton_bench.session.hosted.Hostable`), with an operator."""

    speed_rad_s: float | None = None
    dead_man_s: float = DEAD_MAN_S

    def perform(self, rig: Rig, *, out: Path, seed: int | None, on_event: Watcher, operator: Operator) -> Path:
        """Run it; returns the recording. Raises as every session does; the last event is ``Ended``."""
        from norton_bench.jog.script import JogScript, Pace  # noqa: PLC0415  (brings the report along)
        from norton_bench.session.engine import run_by_hand  # noqa: PLC0415

        bounds = bounds_of(rig, self.speed_rad_s)
        board = Board(operator, rig, bounds, self.dead_man_s)
        script = JogScript(bounds, board, Pace())
        return run_by_hand(rig, script, out=out, seed=seed, on_event=on_event, operator=board)
