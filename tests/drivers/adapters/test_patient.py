"""A reader that insists on waiting, kept away from the loop."""

import time

import can
import pytest

from norton_drivers.adapters.mended_buses import ThreadedBus

pytestmark = pytest.mark.wall_time


class SlowBus(can.BusABC):
    """Like gs_usb: waits at least 20 ms for a frame, and stamps it with a clock of its own."""

    def __init__(self) -> None:
        self.waiting: list[can.Message] = []
        self.sent: list[can.Message] = []
        self.failure: Exception | None = None
        self.channel_info = "slow"
        super().__init__("slow")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.sent.append(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self.failure is not None:
            raise self.failure
        if self.waiting:
            return self.waiting.pop(0), False
        time.sleep(0.02)
        return None, False


@pytest.fixture
def slow():
    return SlowBus()


@pytest.fixture
def bus(slow):
    made = ThreadedBus(slow)
    yield made
    made.shutdown()


def test_a_look_never_waits(bus, slow):
    started_s = time.monotonic()
    assert [bus.recv(0) for _ in range(20)] == [None] * 20
    assert time.monotonic() - started_s < 0.1  # the slow one would have taken 0.4 s


def test_frames_in_order_with_the_time_at_which_they_came(bus, slow):
    slow.waiting += [can.Message(arbitration_id=number, timestamp=0.001) for number in range(5)]
    got = [bus.recv(1) for _ in range(5)]
    assert [message.arbitration_id for message in got] == list(range(5))
    assert all(abs(message.timestamp - time.time()) < 1 for message in got)
    assert bus.recv(0.05) is None


def test_sending_goes_through(bus, slow):
    bus.send(can.Message(arbitration_id=7))
    assert [message.arbitration_id for message in slow.sent] == [7]


def test_a_failure_of_the_thread_is_told(bus, slow):
    slow.failure = OSError("unplugged")
    with pytest.raises(can.CanOperationError, match="cannot receive: unplugged"):
        bus.recv(1)
    with pytest.raises(can.CanOperationError):
        bus.recv(0)


def test_it_ends_with_the_bus(slow):
    made = ThreadedBus(slow)
    made.shutdown()
    assert not made._thread.is_alive()
    assert slow._is_shutdown
