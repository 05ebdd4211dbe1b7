"""One machine with its shaft free: well beyond the command at which it began to turn, it must turn.

An encoder that is stuck on a free shaft shows nowhere else, and the velocity's limit would be blind.
"""

from math import inf

from norton_bench.guard.commands import Commands
from norton_bench.guard.known import Known
from norton_bench.sample import Sample

TIMES = 2.0  # the command at which the shaft began to turn
PATIENCE_NS = 100_000_000
FRESH_NS = 30_000_000  # an encoder that is silent does not stand still


class Standstill:
    """Knows from the step ``tare`` on at which command the shaft turns."""

    name = "standstill"

    def __init__(self, unit: str) -> None:
        self._unit = unit
        self._beyond = inf
        self._position_rad = 0.0
        self._since_ns = 0  # when position or command last did what they should

    def begin(self, sample: Sample) -> None:
        self._since_ns = sample.tick_ns

    def know(self, known: Known) -> None:
        self._beyond = inf if known.moving_command is None else TIMES * abs(known.moving_command)

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        # Bit for bit: any encoder that lives moves by a count within the patience.
        stands = sample.position_rad == self._position_rad and sample.motion_age_ns <= FRESH_NS
        if abs(sent.command) <= self._beyond or not stands:
            self._since_ns, self._position_rad = sample.tick_ns, sample.position_rad
            return None
        if sample.tick_ns - self._since_ns <= PATIENCE_NS:
            return None
        return (
            f"actuator encoder: stands still at {sample.position_rad:.6g} rad for {PATIENCE_NS / 1e6:g} ms under "
            f"{sent.command:.3g} {self._unit}, {TIMES:g} times what set the shaft in motion: the encoder is stuck, or "
            "the shaft is held; check both"
        )
