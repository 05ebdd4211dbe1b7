"""Cases in processes of their own: what comes back is in order, and what goes wrong is not lost."""

from pathlib import Path

import pytest

from norton_bench.errors import RigError
from norton_bench.faults.campaign import FaultTrial, cases, run_campaign
from norton_bench.faults.case import CaseResult, Verdict
from norton_bench.rig.load import load_rig
from tests.bench.half_rate import half_rate

RIGS = Path(__file__).parents[3] / "rigs"


@pytest.mark.long
def test_outcomes_come_in_the_order_of_the_cases() -> None:
    rig = half_rate("sim-odrive")
    names = ("host stalls for a moment", "adapter unplugged")
    chosen = [case for case in cases(rig) if case.name in names]
    heard: list[CaseResult] = []
    outcomes = run_campaign([FaultTrial(rig, chosen)], jobs=2, seed=1, on_outcome=heard.append)
    assert [(outcome.fault, outcome.on) for outcome in outcomes] == [(case.name, case.on) for case in chosen]
    assert sorted(map(str, heard)) == sorted(map(str, outcomes))
    assert {outcome.verdict for outcome in outcomes} == {Verdict.STOPPED, Verdict.RIDDEN_THROUGH}


def test_a_rig_that_cannot_be_tried_ends_the_campaign() -> None:
    rig = load_rig(RIGS / "sim-free-shaft.toml")
    with pytest.raises(RigError, match="needs a load drive"):
        run_campaign([FaultTrial(rig, [])], jobs=1, seed=None, on_outcome=lambda _outcome: None)
