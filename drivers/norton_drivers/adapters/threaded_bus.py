"""A bus whose reader insists on waiting, read by a thread so that the loop never does."""

import threading
import time
from collections import deque

import can

_LOOK_S = 0.1


class ThreadedBus(can.BusABC):
    """Owns ``slow``, whose ``recv`` blocks however short its timeout; here ``recv(0)`` returns at once.

    What arrives is stamped with the time at which the thread had it. A failure of the thread is raised by the next
    ``recv``.
    """

    def __init__(self, slow: can.BusABC) -> None:
        self.channel_info = slow.channel_info
        self._slow = slow
        self._arrived: deque[can.Message] = deque()
        self._signal = threading.Event()
        self._stop = threading.Event()
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._read, name=f"reader of {slow.channel_info}", daemon=True)
        super().__init__(slow.channel_info)
        self._thread.start()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._slow.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._arrived and timeout != 0:
            self._signal.wait(timeout)
        self._signal.clear()
        if self._arrived:
            return self._arrived.popleft(), False
        if self._failure is not None:
            raise can.CanOperationError(f"cannot receive: {self._failure}") from self._failure
        return None, False

    def _read(self) -> None:
        while not self._stop.is_set():
            try:
                message = self._slow.recv(_LOOK_S)
            except Exception as error:  # the adapter's library may raise anything; whoever asks next is told
                self._failure = error
                self._signal.set()
                return
            if message is not None:
                message.timestamp = time.time()
                self._arrived.append(message)
                self._signal.set()

    def shutdown(self) -> None:
        super().shutdown()
        self._stop.set()
        self._thread.join()
        self._slow.shutdown()
