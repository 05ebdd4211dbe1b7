"""The stop key is heard where keys come in, in the terminal driver's own thread: also while the screen is busy.

Bindings run on the event loop, behind whatever is being drawn. A stop must not wait for that, nor for a terminal that
does not take what is written to it.
"""

from collections.abc import Callable
from typing import Any

from textual.driver import Driver
from textual.events import Key
from textual.message import Message

# The driver waits once so many frames are unwritten; more than this, and a frame is left out instead.
MOST_UNWRITTEN = 2


def listening_to_keys(base: type[Driver], on_key: Callable[[str], None]) -> type[Driver]:
    """The platform's driver, which shows every key to ``on_key`` before anything else happens with it."""

    class KeyListener(base):  # type: ignore[valid-type,misc]  # a class by its value
        def process_message(self, message: Message) -> None:
            if isinstance(message, Key):
                on_key(message.key)
            super().process_message(message)

    return KeyListener


def keeps_up(driver: Any) -> bool:
    """Whether the terminal takes what is written to it: over a slow line it does not, and frames would queue up."""
    writer = getattr(driver, "_writer_thread", None)
    queue = getattr(writer, "_queue", None)
    return queue is None or bool(queue.qsize() <= MOST_UNWRITTEN)
