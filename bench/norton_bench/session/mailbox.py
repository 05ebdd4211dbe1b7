"""News on their way to a watcher, who may be slow: parts are bounded in number, all else is kept."""

from collections import deque
from dataclasses import replace
from threading import Condition

from norton_bench.session.news import News, PartNews

# About ten seconds of a session in wall time.
MOST_PARTS = 256


class Mailbox:
    """Between threads. Where too many parts wait, the oldest is dropped, and the next part says how many were."""

    def __init__(self, most_parts: int = MOST_PARTS) -> None:
        self._most_parts = most_parts
        self._news: deque[News] = deque()
        self._parts = 0
        self._closed = False
        self._changed = Condition()

    def put(self, news: News) -> None:
        """Never waits."""
        with self._changed:
            self._news.append(news)
            if isinstance(news, PartNews):
                self._parts += 1
                if self._parts > self._most_parts:
                    self._drop_one()
            self._changed.notify()

    def take(self) -> tuple[News, ...]:
        """All there is, in order. Never waits."""
        with self._changed:
            news = tuple(self._news)
            self._news.clear()
            self._parts = 0
            return news

    def wait(self) -> News | None:
        """The next one, as soon as there is one; None once the box is closed and empty."""
        with self._changed:
            self._changed.wait_for(lambda: self._news or self._closed)
            if not self._news:
                return None
            news = self._news.popleft()
            self._parts -= isinstance(news, PartNews)
            return news

    def close(self) -> None:
        """Nothing more will be put."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def _drop_one(self) -> None:
        places = [place for place, news in enumerate(self._news) if isinstance(news, PartNews)]
        oldest, following = self._news[places[0]], self._news[places[1]]
        assert isinstance(oldest, PartNews)
        assert isinstance(following, PartNews)
        self._news[places[1]] = replace(following, lost=following.lost + oldest.lost + 1)
        del self._news[places[0]]
        self._parts -= 1
