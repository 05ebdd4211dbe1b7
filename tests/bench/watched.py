"""A loop on the simulated backend with an eye on what no device reads: the true port torque during trials."""

from contextlib import AbstractContextManager
from dataclasses import dataclass, field

import numpy as np

from norton_bench.identification.trials import TRIAL
from norton_bench.loop.loop import Loop
from norton_bench.records import Measured
from norton_bench.segments import Segment
from tests.bench.bench_in_simulation import Bench

LOOK_NS = 100_000


@dataclass
class Watched:
    """The loop, with an eye on the true port torque while a trial runs."""

    bench: Bench
    true_rms_nm: list[float] = field(default_factory=list)
    _seen_nm: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        world = self.bench.backend.world
        look = lambda _now: self._seen_nm.append(world.plant.true_port_torque_nm())  # noqa: E731
        world.every(LOOK_NS, look, first_ns=world.now_ns + LOOK_NS)

    @property
    def loop(self) -> Loop:
        return self.bench.loop

    def running(self) -> AbstractContextManager[None]:
        return self.loop.running()

    def run(self, segment: Segment) -> Measured:
        self._seen_nm.clear()
        measured = self.loop.run(segment)
        if segment.name.startswith(TRIAL):
            self.true_rms_nm.append(float(np.sqrt(np.mean(np.square(self._seen_nm)))))
        return measured
