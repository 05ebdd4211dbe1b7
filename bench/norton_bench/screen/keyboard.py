"""The stop key is read in the thread of the terminal driver, so that it works also while the screen is busy.

Bindings run on the event loop, after pending drawing. A stop must not wait for that, nor for a slow terminal.
"""

from collections.abc import Callable
from typing import Any

from textual.driver import Driver
from textual.events import Key
from textual.message import Message

# With more unwritten frames than this a frame is left out; the driver itself would wait at a larger number.
MOST_UNWRITTEN = 2


def listening_to_keys(base: type[Driver], on_key: Callable[[str], None]) -> type[Driver]:
    """The driver of the platform, which calls ``on_key`` with every key before it is handled."""

    class KeyListener(base):  # type: ignore[valid-type,misc]  # a class by its value
        def process_message(self, message: Message) -> None:
            if isinstance(message, Key):
                on_key(message.key)
            super().process_message(message)

    return KeyListener


def keeps_up(driver: Any) -> bool:
    """Whether the terminal keeps up with the frames; over a slow line they would queue up."""
    writer = getattr(driver, "_writer_thread", None)
    queue = getattr(writer, "_queue", None)
    return queue is None or bool(queue.qsize() <= MOST_UNWRITTEN)
