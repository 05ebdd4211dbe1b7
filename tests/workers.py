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
    """Whole files, in their order; those against the wall clock to one worker, as long as there are any."""

    def __init__(self, config: pytest.Config, log: object) -> None:
        super().__init__(config, log)  # type: ignore[arg-type]
        self._against_the_clock = files_against_the_clock(config.rootpath)

    def _assign_work_unit(self, node: WorkerController) -> None:
        """The next of its kind, or the next that is left."""
        punctual = node.gateway.id == PUNCTUAL
        of_its_kind = (file for file in self.workqueue if self._against_the_clock(file) == punctual)
        self.workqueue.move_to_end(next(of_its_kind, next(iter(self.workqueue))), last=False)
        super()._assign_work_unit(node)


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
