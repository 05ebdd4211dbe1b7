"""One command, several torques: what a blocked port exerts tells how it came to rest (paper, section IV.D)."""

import numpy as np
import pytest

from norton_bench.errors import UsageError
from norton_bench.identification.source_map import blocked_map
from norton_bench.procedures.options import BlockedOptions, CalibrateOptions, FreeOptions, TareOptions
from norton_bench.session.engine import record_session
from norton_bench.session.schema import Session, Step, parse_session
from norton_sim.truth import read_truth
from tests.bench.half_rate import half_rate

RIG = half_rate("sim-odrive")


@pytest.mark.long
def test_friction_leaves_what_the_history_says(tmp_path):
    blocked = BlockedOptions(levels=2, hold_s=0.3, histories=("slow", "fast", "rest"))
    steps = (
        Step("tare", TareOptions(duration_s=0.5)),
        Step("calibrate", CalibrateOptions(duration_s=4.0)),
        Step("free", FreeOptions(levels=3, dwell_s=0.2, duration_s=1.0)),  # for commands of everyday size
        Step("blocked", blocked),
    )
    recorded = record_session(RIG, Session(steps, "short"), out=tmp_path, seed=2, live=False)
    found, motor = blocked_map(recorded.measured), read_truth(RIG.simulated, seed=None, place="").actuator.motor
    drive_nm = motor.Km * motor.Ka * found.command
    assert [np.count_nonzero(found.chosen(history)) for history in ("slow", "fast", "rest")] == [4, 4, 2]
    above, below = (found.chosen("slow") & side for side in (found.from_above, ~found.from_above))
    # Twice the Coulomb torque, less what the shaft creeps back while it is being stopped.
    apart = found.torque_nm[below] - found.torque_nm[above]
    assert np.all((apart > motor.tau_c) & (apart < 2.3 * motor.tau_c))
    # However it came to rest, friction leaves no more than itself; a quick stop, or none, leaves something else.
    assert np.all(np.abs(found.torque_nm - drive_nm) < 1.3 * motor.tau_c)
    quick = found.chosen("fast") & found.from_above
    assert np.max(np.abs(found.torque_nm[quick] - found.torque_nm[above])) > 0.2 * motor.tau_c


def test_a_history_that_nobody_knows_is_refused():
    with pytest.raises(UsageError, match="histories"):
        parse_session('[[step]]\ndo = "blocked"\nhistories = ["sudden"]\n', place="session.toml")
