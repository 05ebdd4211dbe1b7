"""A procedure and a loop brought together: what takes time is done before the drives are enabled."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from norton_bench.procedures.knowledge import Knowledge, Plan, carry_out
from norton_bench.procedures.waves import coasting
from norton_bench.records import TICK, Measured
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use
from tests.bench.procedures.test_procedures import RIGS


@dataclass
class Noting:
    """Procedure, loop and foresight in one: what was asked of them, in order."""

    asked: list[str] = field(default_factory=list)
    name = "noting"

    def require(self, rig: Rig) -> None: ...

    def duration_s(self, rig: Rig) -> float:
        return 0.0

    def plan(self, known: Knowledge) -> Plan:
        for name in ("one", "two"):
            self.asked.append(f"plan {name}")
            yield coasting("test", name, Use.PREPARE, np.zeros(1))

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        self.asked.append("conclude")
        return known

    @contextmanager
    def running(self) -> Iterator[None]:
        self.asked.append("enable")
        yield
        self.asked.append("idle")

    def run(self, segment: Segment) -> Measured:
        self.asked.append(f"run {segment.name}")
        return Measured(ticks=np.zeros(1, TICK))

    def foresee(self, segment: Segment, position_rad: float | None, velocity_rad_s: float, command: float) -> Segment:
        self.asked.append(f"foresee {segment.name}")
        return segment


def test_the_first_segment_is_planned_and_foreseen_before_the_drives_are_enabled() -> None:
    noting = Noting()
    carry_out(noting, Knowledge(load_rig(RIGS / "sim-odrive.toml")), noting, noting.foresee)
    begun = ["plan one", "foresee one", "enable", "run one"]
    assert noting.asked == [*begun, "plan two", "foresee two", "run two", "idle", "conclude"]
