"""The loop in a process of its own, as its session sees it: the same loop, orders in, shared memory out."""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import replace
from multiprocessing.connection import wait
from typing import Any

from norton_bench.errors import BenchError, SafetyStopError
from norton_bench.loop.bench_loop import Learned
from norton_bench.loop.devices import WatchdogFinding, open_devices
from norton_bench.loop.orders import (
    Close,
    Enable,
    Failed,
    Identify,
    Idle,
    Idled,
    Learn,
    Order,
    Pulse,
    ResetGuard,
    Run,
    VerifyWatchdogs,
    send_in_pieces,
)
from norton_bench.loop.outbox import SharedInbox, SharedMemory
from norton_bench.loop.service import Shared, serve_loop
from norton_bench.loop.stop_word import StopWord
from norton_bench.records import NO_SEGMENT, Event, Measured, SegmentInfo, Table, join
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment
from norton_drivers.errors import DeviceError
from norton_drivers.readings import DeviceIdentity
from norton_drivers.real_time import ProcessSetup, staying_off
from norton_drivers.registry import load_backend

# How often the session beats, and looks at what the loop has put away.
PART_S = 0.04
# A loop that does not tick for so long has been stopped, or hangs.
TICKS_WITHIN_S = 2.0
# Enabling drives that want to be brought up state by state.
ENABLED_WITHIN_S = 30.0
# Importing everything, opening a slow device, compiling a controller for the first time.
ANSWER_WITHIN_S = 120.0
END_WITHIN_S = 5.0
HEARD_WITHIN_NS = 250_000_000
# Libraries that calculate in several threads start those when they are imported.
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class LoopProcess:
    """A :class:`norton_bench.loop.bench_loop.BenchLoop` on the rig's own devices, in wall time, until :meth:`close`.

    The loop opens them itself, and looks at ``stop`` every tick. Raises what opening them raises: WiringError,
    RigError, ConnectionFailedError. Every method raises SafetyStopError once the loop has died.
    """

    def __init__(self, rig: Rig, stop: StopWord | None = None, *, seed: int | None = None) -> None:
        context = multiprocessing.get_context("spawn")
        self._rig, self._seed = rig, seed
        self._consumer: Callable[[Measured], None] = _nobody
        self._enabled = False
        self._gone: SafetyStopError | None = None
        self._begun = (-1, 0)  # the segment that runs, and its first tick [ns]
        self._shared = Shared(SharedMemory(rig), stop or StopWord(), Pulse())
        self._inbox, self._beat_ns = SharedInbox(self._shared.memory), self._shared.pulse.view()
        self._orders, emulated = context.Pipe()
        self._process = context.Process(
            target=serve_loop,
            args=(rig, seed, self._shared, emulated),
            name="loop",
            daemon=True,
        )
        with _environment(ONE_THREAD):
            self._process.start()
        emulated.close()  # or the loop's end would never be seen
        self._with_it = ExitStack()
        try:
            self._settled: ProcessSetup = self._wait_for_answer()
        except BaseException:
            self._end()
            raise
        self._with_it.enter_context(staying_off(self._settled.core))

    @property
    def pid(self) -> int:
        """The loop's process."""
        return self._process.pid or 0

    @property
    def lost(self) -> int:
        """How many records the session was too late for."""
        return self._inbox.lost

    @property
    def notes(self) -> tuple[str, ...]:
        return self._settled.notes

    @property
    def place(self) -> str:
        return self._settled.words

    @property
    def now_ns(self) -> int:
        return time.monotonic_ns()

    def subscribe(self, consumer: Callable[[Measured], None]) -> None:
        self._inbox.skip()
        self._consumer = consumer

    def tell(self, kind: str, text: str, stamp_ns: int | None = None) -> None:
        self._consumer(Measured(events=(Event(self.now_ns if stamp_ns is None else stamp_ns, kind, text),)))

    def identify(self) -> list[DeviceIdentity]:
        found: list[DeviceIdentity] = self._ask(Identify())
        return found

    def verify_watchdogs(self) -> tuple[WatchdogFinding, ...]:
        found: tuple[WatchdogFinding, ...] = self._ask(VerifyWatchdogs())
        return found

    def learn(self, learned: Learned) -> None:
        self._ask(Learn(learned))

    def reset_guard(self, word: str) -> None:
        self._ask(ResetGuard(word))

    @contextmanager
    def running(self) -> Iterator[None]:
        self._enabled = True  # from the order on, whatever becomes of it
        try:
            self._send(Enable())
            self._wait_for_answer(ENABLED_WITHIN_S)
        except BaseException:
            self._enabled = False
            self._hand_on()
            raise
        try:
            self._hand_on()  # the bench is held already: who stumbles over what was measured must idle the drives
            yield
        except BaseException as error:
            self._idle(error)
            raise
        self._idle(None)

    def run(self, segment: Segment) -> Measured:
        if not self._enabled:
            raise RuntimeError("segments are run inside running(), until the drives are idled")
        parts: list[Measured] = []
        self._send(Run(segment))
        answer = self._answer(lambda: parts.append(self._hand_on(segment)), TICKS_WITHIN_S)
        if isinstance(answer, Idled):
            self._enabled = False
            self._hand_on(segment)
            raise answer.error or SafetyStopError("the loop has idled the drives by itself", "loop")
        parts.append(self._hand_on(segment, answer.value))
        measured = join(parts)
        return replace(measured, ticks=measured.ticks[measured.ticks["segment"] == answer.value.index])

    def close(self) -> None:
        """End the loop's process; the drives are idle then. May be called twice."""
        with suppress(OSError):
            send_in_pieces(self._orders, Close())
        self._end()

    def __enter__(self) -> "LoopProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _end(self) -> None:
        self._with_it.close()
        self._orders.close()
        self._process.join(END_WITHIN_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def _ask(self, order: Order, within_s: float = ANSWER_WITHIN_S) -> Any:
        """What the order is answered with; what it fails with is raised. What is measured meanwhile is handed on."""
        self._send(order)
        try:
            return self._wait_for_answer(within_s)
        finally:
            self._hand_on()

    def _wait_for_answer(self, within_s: float = ANSWER_WITHIN_S) -> Any:
        answer = self._answer(_nothing, within_s)
        if isinstance(answer, Failed):
            raise answer.error
        return answer.value

    def _idle(self, error: BaseException | None) -> None:
        """See the drives idled, unless they are. Of errors the loop puts away those that are the user's business."""
        if not self._enabled:
            return
        self._enabled = False
        self._send(Idle(error if isinstance(error, BenchError | DeviceError) else None))
        while not isinstance(answer := self._answer(_nothing), Idled):
            pass  # of a segment that was over just then
        self._hand_on()
        if error is None and answer.error is not None:
            raise answer.error

    def _send(self, order: Order) -> None:
        self._beat()
        try:
            send_in_pieces(self._orders, order)
        except OSError:
            raise self._lost("has died") from None

    def _answer(self, look: Callable[[], object], within_s: float = ANSWER_WITHIN_S) -> Any:
        """The next message, looking and beating meanwhile. Raises SafetyStopError where the loop is dead or silent.

        Where this process itself stood still, as all do on a virtual machine that is paused, no more than half of
        ``within_s`` counts: the loop is looked at once more before it is called silent.
        """
        ticks, looked_s, silent_s = self._inbox.ticks, time.monotonic(), 0.0
        while not (ready := wait([self._orders, self._process.sentinel], PART_S)) or self._orders not in ready:
            if ready:
                raise self._died()
            self._beat()
            look()
            now_s, before = time.monotonic(), ticks
            ticks = self._inbox.ticks
            silent_s = silent_s + min(now_s - looked_s, within_s / 2) if ticks == before else 0.0
            looked_s = now_s
            if silent_s > within_s:
                self._process.kill()
                raise self._lost(f"has not been heard for {within_s:g} s")
        try:
            return self._orders.recv()
        except (EOFError, OSError):
            raise self._died() from None

    def _beat(self) -> None:
        self._beat_ns[0] = time.monotonic_ns()

    def _died(self) -> SafetyStopError:
        self._process.join(END_WITHIN_S)  # what it leaves is closed before its ending is known
        return self._lost(f"has died ({_ending(self._process.exitcode)})")

    def _lost(self, how: str) -> SafetyStopError:
        """The error to raise; what the loop has put away until then is in the recording, and that it is gone."""
        if self._gone is not None:
            return self._gone
        self._process.join(END_WITHIN_S)
        was_enabled, self._enabled = self._enabled, False
        said = f"the loop's process {how}"
        if was_enabled:
            said += f"; {_idled_in_its_place(self._rig, self._seed)}"
        self._hand_on()
        self.tell("stop", said)
        self._gone = SafetyStopError(said, "loop")
        return self._gone

    def _hand_on(self, segment: Segment | None = None, info: SegmentInfo | None = None) -> Measured:
        """Give the consumer what has come; ``info`` describes the segment once it is over."""
        measured = self._inbox.take()
        if segment is not None and info is None:
            info = self._so_far(segment, measured.ticks[measured.ticks["segment"] != NO_SEGMENT])
        part = replace(measured, segments=() if info is None else (info,), chain=self._rig.chain)
        if not part.empty:
            self._consumer(part)
        return part.without_frames()

    def _so_far(self, segment: Segment, ticks: Table) -> SegmentInfo | None:
        """The segment so far; None before its first tick."""
        if not len(ticks):
            return None
        index = int(ticks["segment"][-1])
        if index != self._begun[0]:
            self._begun = index, int(ticks["tick_ns"][0])
        end_ns = int(ticks["tick_ns"][-1]) + self._rig.tick_ns
        return SegmentInfo.of(segment, index, self._begun[1], end_ns)


def _idled_in_its_place(rig: Rig, seed: int | None) -> str:
    """Open the devices and idle the drives: sooner than their watchdogs would, which not every drive has."""
    try:
        backend = load_backend(rig.backend)(rig.wiring, rig.simulated, seed=seed, place=rig.place)
        with closing(backend):
            devices = open_devices(rig, backend)
            devices.stop()
            devices.link.wait(HEARD_WITHIN_NS)  # their state is known only after their next heartbeats
            complaints = devices.stop()
    except Exception as error:  # any: the drives' watchdogs are left, and the message is the loop's death
        return (
            f"the drives could not be idled in its place ({error}): if they have no watchdog, switch off their supply"
        )
    return "; ".join(complaints) or "the drives were idled in its place"


def _ending(exit_code: int | None) -> str:
    """How a process ended, as text."""
    if exit_code is not None and exit_code < 0:
        return f"ended by {signal.Signals(-exit_code).name}"
    return f"exit code {exit_code}"


@contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Inside, for processes that are started there; what is set already stays."""
    added = [name for name in variables if name not in os.environ]
    os.environ.update({name: variables[name] for name in added})
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


def _nobody(_part: Measured) -> None:
    """Before anybody has subscribed."""


def _nothing() -> None:
    """Nothing to look at meanwhile."""
