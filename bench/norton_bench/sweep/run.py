"""A sweep under way: tasks to an executor, outcomes to the disk as they come."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager

from norton_bench.errors import UsageError
from norton_bench.extras import extra
from norton_bench.session.pool import process_pool
from norton_bench.sweep.store import Store
from norton_bench.sweep.task import Outcome, Task, carry_out


def sweep(
    tasks: Sequence[Task], executor: Executor, store: Store, on_outcome: Callable[[Outcome], None]
) -> tuple[Outcome, ...]:
    """The outcomes of all ``tasks``, in their order; what ``store`` has already is not done again.

    ``on_outcome`` hears of each that is new, once it is on disk. ``executor`` is any of concurrent.futures, or
    anything with its interface; what it has not begun is cancelled where this is interrupted.
    """
    _check_names(tasks)
    found = {task.name: store.done[task.name] for task in tasks if task.name in store.done}
    futures = [executor.submit(carry_out, task) for task in tasks if task.name not in found]
    try:
        for done in as_completed(futures):
            outcome = done.result()
            store.put(outcome)
            found[outcome.name] = outcome
            on_outcome(outcome)
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    finally:
        store.close()
    return tuple(found[task.name] for task in tasks)


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
