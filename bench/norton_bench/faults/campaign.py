"""Many cases on several rigs: in lock step as many at a time as there are jobs, then in wall time one by one."""

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass

from norton_bench.faults.case import Case, Outcome
from norton_bench.faults.exercise import Exercise
from norton_bench.faults.host_loss import lose_host
from norton_bench.faults.rehearse import longest_watchdog_s, prepare, rehearse
from norton_bench.rig.rig import Rig
from norton_bench.session.pool import process_pool

OnOutcome = Callable[[Outcome], None]


@dataclass(frozen=True)
class Trial:
    """What to try on one rig: ``cases`` in lock step, ``losses`` of the host in wall time."""

    rig: Rig
    cases: Sequence[Case]
    losses: Sequence[Case] = ()

    @property
    def count(self) -> int:
        return len(self.cases) + len(self.losses)


def run_campaign(trials: Sequence[Trial], jobs: int, seed: int | None, on_outcome: OnOutcome) -> list[Outcome]:
    """All outcomes, rig by rig in the order of its cases; ``on_outcome`` hears of each as it comes.

    Raises RigError for a rig without a load drive; BenchError, DeviceError where one does not get as far as its faults.
    """
    for trial in trials:
        Exercise().require(trial.rig)
    by_rig = _in_lock_step(trials, jobs, seed, on_outcome)
    for trial, outcomes in zip(trials, by_rig, strict=True):
        # One by one, and nothing beside them: they are about time.
        for case in trial.losses:
            outcomes.append(lose_host(trial.rig, case, longest_watchdog_s(trial.rig), seed))
            on_outcome(outcomes[-1])
    return [outcome for outcomes in by_rig for outcome in outcomes]


def _in_lock_step(trials: Sequence[Trial], jobs: int, seed: int | None, on_outcome: OnOutcome) -> list[list[Outcome]]:
    with process_pool(jobs) as pool:
        ready = {index: pool.submit(prepare, trial.rig, seed) for index, trial in enumerate(trials) if trial.cases}
        futures = [
            [pool.submit(rehearse, ready[index].result(), case, seed) for case in trial.cases]
            for index, trial in enumerate(trials)
        ]
        for done in as_completed([future for row in futures for future in row]):
            on_outcome(done.result())
        return [[future.result() for future in row] for row in futures]
