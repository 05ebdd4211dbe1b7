"""The loop's process: it opens the bench by itself, does what the session orders, and does nothing beside.

While the drives are enabled it ticks; otherwise it reads its ports, so that nothing stale waits in them.
"""

import gc
import pickle
import signal
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection
from types import FrameType
from typing import Any

from norton_bench.errors import BenchError
from norton_bench.loop.devices import guard_for, open_devices
from norton_bench.loop.loop import Loop
from norton_bench.loop.orders import (
    Close,
    Done,
    Enable,
    Failed,
    Identify,
    Idle,
    Idled,
    Learn,
    LeaveError,
    Order,
    PieceReader,
    Pulse,
    ResetGuard,
    Run,
    SessionWatch,
    VerifyWatchdogs,
)
from norton_bench.loop.outbox import SharedMemory, SharedOutbox
from norton_bench.loop.stop_word import StopWord
from norton_bench.rig.rig import Rig
from norton_bench.sample import Alignment
from norton_drivers.errors import DeviceError
from norton_drivers.real_time import LOOP_PRIORITY, in_real_time, kept_awake, prepare_process, take_core
from norton_drivers.registry import load_backend

# While the drives are idle: well before the least of the systems' buffers is full.
LISTEN_S = 0.005


@dataclass(frozen=True)
class Shared:
    """What a session and its loop have in common."""

    memory: SharedMemory
    stop: StopWord
    pulse: Pulse


def serve_loop(rig: Rig, seed: int | None, shared: Shared, orders: "Connection[Any, Any]") -> None:
    """What the process runs until the session closes the pipe or says Close. Its first answer is its rights."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches every process; the session decides what follows
    core = take_core()
    settled = prepare_process(None if core is None else core.number)
    with ExitStack() as stack:
        try:
            backend = load_backend(rig.backend)(rig.wiring, rig.simulated, seed=seed, place=rig.place)
            stack.callback(backend.close)
            devices = open_devices(rig, backend)
            stack.callback(devices.link.close)
        except Exception as error:
            orders.send(Failed(_portable(error)))
            return
        outbox = SharedOutbox(shared.memory)
        loop = Loop(devices, guard_for(rig, devices), outbox, Alignment(), rig.tick_ns)
        loop.command_may_be_a_place = rig.command_may_be_a_place
        service = _Service(loop, outbox, shared, orders, settled.core)
        with suppress(OSError):  # the session has gone; the drives are idle
            orders.send(Done(settled))
            service.serve()


@dataclass
class _Service:
    """Carries out orders, one after the other."""

    loop: Loop
    outbox: SharedOutbox
    shared: Shared
    orders: "Connection[Any, Any]"
    core: int | None
    _ended: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        self._reader = PieceReader(self.orders)
        self._watch = SessionWatch(self.shared.pulse, self._reader, self.loop.devices.clock)
        self.loop.stop_request = self._asked_to_stop
        self.loop.on_time = partial(_undisturbed, self.core)
        signal.signal(signal.SIGTERM, self._end)

    def serve(self) -> None:
        """Until the session is gone or closes."""
        while not isinstance(order := self._next_order(), Close):
            if isinstance(order, Enable):
                self._enable()
            elif not isinstance(order, Idle | Run):  # sent before the session knew that the drives are idle
                self.orders.send(self._answer(order))

    def _next_order(self) -> Order:
        """Wait for it. Ports are read meanwhile, and what arrives is dropped."""
        listening = True
        while not self._ended:
            if self._reader.ready() or self.orders.poll(LISTEN_S):
                with suppress(EOFError):
                    order: Order = self._reader.read()
                    return order
                break
            if listening:
                try:
                    self.loop.devices.receive()
                except DeviceError:  # the next order meets the same error, and reports it
                    listening = False
        return Close()

    def _answer(self, order: Order) -> Done | Failed:
        try:
            return Done(self._carry_out(order))
        except Exception as error:
            return Failed(_portable(error))

    def _carry_out(self, order: Order) -> Any:
        match order:
            case Identify():
                return self.loop.identify()
            case VerifyWatchdogs():
                with self._tapped():
                    return self.loop.verify_watchdogs()
            case Learn(learned):
                return self.loop.learn(learned)
            case ResetGuard(word):
                return self.loop.reset_guard(word)
        raise TypeError(f"{order} is out of turn")

    def _enable(self) -> None:
        """Enable the drives, run what is ordered, and idle them."""
        enabled, error = False, None
        try:
            with self._tapped(), self.loop.running():
                enabled = True
                self.orders.send(Done())
                self._run_segments()
        except LeaveError:
            pass
        except Exception as raised:
            error = _portable(raised)
        self.orders.send(Idled(error) if enabled or error is None else Failed(error))

    def _run_segments(self) -> None:
        """Until the session orders the drives to be idle. Its reason is raised here, so that it is recorded."""
        while isinstance(order := self._next_order_held(), Run):
            try:
                with self._watch.segment():
                    measured = self.loop.run(order.segment)
            except LeaveError as left:
                order = left.idle
                break
            self.orders.send(Done(measured.segments[-1]))
        if isinstance(order, Idle) and order.error is not None:
            raise order.error

    def _next_order_held(self) -> Order:
        """The bench is held, guarded, until it comes."""
        self.loop.hold(self._watch.ordered)
        return self._watch.read()

    def _asked_to_stop(self) -> str | None:
        self._watch.look()
        return self.shared.stop.heard()

    def _end(self, _number: int, _frame: FrameType | None) -> None:
        """Asked to end by the system: idle first, then go."""
        self._ended = True
        self.shared.stop.say("the loop was asked to end")

    @contextmanager
    def _tapped(self) -> Iterator[None]:
        """Inside, all frames are put away."""
        self.loop.devices.link.set_tap(self.outbox.put_frame)
        try:
            yield
        finally:
            self.loop.devices.link.set_tap(None)


@contextmanager
def _undisturbed(core: int | None) -> Iterator[None]:
    """Inside, in real time, its own core awake, and no garbage is collected: a tick leaves none that needs it."""
    with kept_awake(core), in_real_time(LOOP_PRIORITY):
        gc.disable()
        try:
            yield
        finally:
            gc.enable()


def _portable(error: Exception) -> Exception:
    """An error that the pipe can carry; a mistake of the program takes its traceback along as a note."""
    if not isinstance(error, BenchError | DeviceError):
        error.add_note("".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError("".join(traceback.format_exception(error)))
    return error
