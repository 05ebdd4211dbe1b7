"""The loop in the session's own process: in lock step, where time waits for everybody, and on a backend passed in."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

from norton_bench.loop.devices import guard_for, open_devices
from norton_bench.loop.loop import Loop
from norton_bench.loop.outbox import Outbox
from norton_bench.loop.stop_word import never_stop
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.sample import Alignment
from norton_drivers.ports import Backend
from norton_drivers.real_time import LOOP_PRIORITY, in_real_time


@dataclass
class InProcessLoop(Loop):
    """A :class:`norton_bench.loop.bench_loop.BenchLoop` without processes or memory to share."""

    outbox: Outbox

    def subscribe(self, consumer: Callable[[Measured], None]) -> None:
        self.outbox.consumers = (consumer,)
        self.devices.link.set_tap(self.outbox.put_frame)

    def tell(self, kind: str, text: str, stamp_ns: int | None = None) -> None:
        self.outbox.put_event(self.now_ns if stamp_ns is None else stamp_ns, kind, text)
        self.outbox.hand_on()

    @property
    def now_ns(self) -> int:
        return self.devices.clock.now_ns()

    @property
    def notes(self) -> tuple[str, ...]:
        return ()

    @property
    def place(self) -> str:
        return "in the session's process"


@contextmanager
def loop_in_process(
    rig: Rig, backend: Backend, stop_request: Callable[[], str | None] = never_stop
) -> Iterator[InProcessLoop]:
    """The rig's devices, open, with a loop. Raises WiringError, RigError, ConnectionFailedError."""
    devices = open_devices(rig, backend)
    try:
        outbox = Outbox(chain=rig.chain)
        loop = InProcessLoop(devices, guard_for(rig, devices), outbox, Alignment(), rig.tick_ns, stop_request)
        loop.command_may_be_a_place = rig.command_may_be_a_place
        if not backend.lock_step:
            loop.on_time = partial(in_real_time, LOOP_PRIORITY)
        yield loop
    finally:
        devices.link.close()
