"""Whole sessions on drives that command and tell in coarse steps: errors stay within the deviations that are stated."""

from pathlib import Path

import pytest

from norton_bench.identification.judged_fit import fit
from norton_bench.models.parameters import Estimate, Status
from norton_bench.procedures.options import CalibrateOptions, FreeOptions, ImposedOptions, TareOptions
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.session.engine import record_session
from norton_bench.session.schema import Session, Step
from norton_sim.tools import true_parameters
from tests.bench.half_rate import half_rate, half_rate_text

pytestmark = pytest.mark.long

# Of eighteen values one in a thousand tries lies farther out than this.
GREATEST_DEVIATION_STD = 4.0
SEED = 5
SESSION = Session(
    (
        Step("tare", TareOptions(duration_s=0.5)),
        Step("calibrate", CalibrateOptions(duration_s=4.0)),
        Step("free", FreeOptions(levels=3, dwell_s=0.2, duration_s=2.0)),
        Step("imposed", ImposedOptions(velocities_rad_s=(-20.0, 20.0), commands=2, duration_s=3.0)),
    ),
    place="test",
)


def identified(rig: Rig, out: Path) -> dict[str, Estimate]:
    """The parameters by name, each within its own deviations of the true one."""
    measured = record_session(rig, SESSION, out=out, seed=SEED, live=False).measured
    result = fit(measured, command_unit=rig.command.unit, tick_s=rig.tick_s)
    found = {estimate.name: estimate for estimate in result.estimates}
    truth = true_parameters(rig.simulated, seed=SEED, place="", command_unit=rig.command.unit)
    assert set(found) == set(truth)
    for name, (true, unit) in truth.items():
        estimate = found[name]
        assert (estimate.unit, estimate.status) == (unit, Status.VALID)
        assert 0.0 < abs(estimate.value - true) < GREATEST_DEVIATION_STD * estimate.std, name
    return found


@pytest.mark.parametrize(
    ("rig_name", "current_known_to"),
    [
        ("sim-vesc", (4e-3, 1.5e-2)),  # currents in steps of 0.1 A: no session makes them finer
        ("sim-mit", (5e-4, 4e-3)),
    ],
)
def test_every_parameter_is_found_within_its_own_deviation(
    rig_name: str, current_known_to: tuple[float, float], tmp_path: Path
) -> None:
    found = identified(half_rate(rig_name), tmp_path)
    least, most = current_known_to
    for name in ("torque_constant", "amplifier_gain"):
        assert least < found[name].std / found[name].value < most, name


def test_a_drive_in_profile_torque_is_found_as_well(tmp_path: Path) -> None:
    text, mode = half_rate_text("sim-cia402"), 'mode = "cyclic synchronous torque"'
    ramping = 'mode = "profile torque"\ntorque_slope = "1000 N*m/s"'
    assert identified(parse_rig(text.replace(mode, ramping, 1), place="ramping.toml"), tmp_path)
