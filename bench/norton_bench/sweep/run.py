"""A sweep under way: tasks to an executor, outcomes to the disk as they come."""

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import TextIOWrapper
from pathlib import Path

from norton_bench.errors import UsageError
from norton_bench.on_demand import extra
from norton_bench.session.pool import process_pool
from norton_bench.sweep.task import Task, TaskResult, carry_out

RESULTS, ABOUT = "results.jsonl", "sweep.json"


@dataclass
class Store:
    """A sweep's results on disk: a line of JSON for each, as they come, and what they are results of.

    ``done`` holds what earlier runs have finished, by name: what failed then is not among it.
    """

    folder: Path
    done: dict[str, TaskResult] = field(default_factory=dict)
    _file: TextIOWrapper | None = field(default=None, init=False)

    @classmethod
    def opened(cls, folder: Path, about: Mapping[str, str]) -> "Store":
        """The store in ``folder``, made where it is not there; ``about`` says what is swept.

        Raises UsageError where the folder cannot be made, or holds another sweep.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _check_same(folder, about)
            outcomes = {outcome.name: outcome for outcome in _read(folder / RESULTS)}
        except OSError as error:
            raise UsageError(
                f"{folder}: cannot be used ({error.strerror}); choose another folder with --out"
            ) from error
        return cls(folder, {name: outcome for name, outcome in outcomes.items() if not outcome.failure})

    def put(self, outcome: TaskResult) -> None:
        """On disk when this returns. Raises UsageError where it cannot be written."""
        try:
            if self._file is None:
                self._file = _appending(self.folder / RESULTS)
            self._file.write(json.dumps(outcome.as_json(), ensure_ascii=False) + "\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise UsageError(f"{self.folder / RESULTS}: cannot be written ({error.strerror})") from error
        if not outcome.failure:
            self.done[outcome.name] = outcome

    def close(self) -> None:
        if self._file is not None:
            self._file.close()


def _check_same(folder: Path, about: Mapping[str, str]) -> None:
    path = folder / ABOUT
    if not path.exists():
        path.write_text(json.dumps(dict(about), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        return
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise UsageError(f"{path}: is not what a sweep has written; choose another folder with --out") from error
    for key, value in about.items():
        if before.get(key) != value:
            raise UsageError(f"{folder}: holds a sweep with another {key}; choose another folder with --out")


def _read(path: Path) -> Iterator[TaskResult]:
    """All that was written whole: whoever was killed while writing leaves half a line."""
    if not path.exists():
        return
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            yield TaskResult.of_json(json.loads(line))
        except (ValueError, KeyError, TypeError):
            continue


def _appending(path: Path) -> TextIOWrapper:
    """At the beginning of a line."""
    torn = path.exists() and not path.read_bytes().endswith(b"\n") and path.stat().st_size > 0
    file = path.open("a", encoding="utf-8")
    if torn:
        file.write("\n")
    return file


def sweep(
    tasks: Sequence[Task], executor: Executor, store: Store, on_outcome: Callable[[TaskResult], None]
) -> tuple[TaskResult, ...]:
    """The outcomes of all ``tasks``, in their order; what ``store`` has already is not done again.

    ``on_outcome`` hears of each that is new, once it is on disk. ``executor`` is any of concurrent.futures, or
    anything with its interface; what it has not begun is cancelled where this is interrupted.
    """
    _check_names(tasks)
    result = {task.name: store.done[task.name] for task in tasks if task.name in store.done}
    futures = [executor.submit(carry_out, task) for task in tasks if task.name not in result]
    try:
        for done in as_completed(futures):
            outcome = done.result()
            store.put(outcome)
            result[outcome.name] = outcome
            on_outcome(outcome)
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    finally:
        store.close()
    return tuple(result[task.name] for task in tasks)


@contextmanager
def executor_of(jobs: int, cluster: str | None) -> Iterator[Executor]:
    """``jobs`` processes here, or the Dask cluster whose scheduler is at ``cluster``.

    Raises UsageError where Dask is not installed, or nothing answers at the address.
    """
    if cluster is None:
        with process_pool(jobs) as pool:
            yield pool
        return
    distributed = extra("distributed", "--cluster")
    try:
        client = distributed.Client(cluster, timeout="10s")
    except (OSError, ValueError) as error:
        raise UsageError(f"--cluster {cluster}: no Dask scheduler answers there ({error})") from error
    with client, client.get_executor() as executor:
        yield executor


def _check_names(tasks: Sequence[Task]) -> None:
    names = [task.name for task in tasks]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise UsageError(f"{twice}: is named twice in this sweep; name everything once")
