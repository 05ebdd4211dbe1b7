"""Which worker runs which files: tests against the wall clock have one of their own, which goes first for a processor.

They wait for ports, sockets and watchdogs most of the time. With as many workers as processors, a processor waits with
them; so there is one worker more, and those that compute stand back whenever it has something to do.
"""

import os
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from xdist.scheduler import LoadFileScheduling
from xdist.workermanage import WorkerController

PUNCTUAL = "gw0"
FEWEST = 3  # workers, of which one can be spared
# A quarter of a processor where both want it (Linux weighs 335 to 1024); not starved where others compute, too.
NICE = 5


class ByClock(LoadFileScheduling):
    """Whole files, in their order; those against the wall clock to one worker, which then takes others, too."""

    def __init__(self, config: pytest.Config, log: object) -> None:
        super().__init__(config, log)  # type: ignore[arg-type]
        self._against_the_clock = files_against_the_clock(config.rootpath)

    def _assign_work_unit(self, node: WorkerController) -> None:
        """The next that is for this worker, if there is one."""
        file = self._next_for(node)
        if file is not None:
            self.workqueue.move_to_end(file, last=False)
            super()._assign_work_unit(node)

    def _reschedule(self, node: WorkerController) -> None:
        """Or the worker's end."""
        if self._next_for(node) is not None:
            super()._reschedule(node)
        elif not node.shutting_down:
            node.shutdown()

    def _next_for(self, node: WorkerController) -> str | None:
        """Of its own kind, or the next that is left; but nothing against the clock while another is there for it."""
        punctual = node.gateway.id == PUNCTUAL
        own = (file for file in self.workqueue if self._against_the_clock(file) == punctual)
        left_to_it = not punctual and any(other.gateway.id == PUNCTUAL for other in self.nodes)
        return next(own, None if left_to_it else next(iter(self.workqueue), None))


def files_against_the_clock(root: Path) -> Callable[[str], bool]:
    """Whether a file, named as pytest does, holds tests with the mark."""
    return cache(lambda file: "mark.wall_time" in (root / file).read_text(encoding="utf-8"))


def spares_one(config: pytest.Config) -> bool:
    return config.getoption("dist", "no") == "loadfile" and (config.getoption("numprocesses", 0) or 0) >= FEWEST


def stand_back(config: pytest.Config) -> None:
    """Lets the worker against the clock go first, unless this one is it, or there is none."""
    worker: dict[str, object] = getattr(config, "workerinput", {})
    if worker and int(str(worker["workercount"])) >= FEWEST and worker["workerid"] != PUNCTUAL:
        os.nice(NICE)
