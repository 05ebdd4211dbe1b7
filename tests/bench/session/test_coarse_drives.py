"""Whole sessions on drives that command and tell in coarse steps: errors stay within the deviations that are stated."""

from pathlib import Path

import pytest

from bench.models.parameters import Status
from bench.procedures.options import CalibrateOptions, FreeOptions, ImposedOptions, TareOptions
from bench.rig.load import load_rig
from bench.session.engine import run_session
from bench.session.schema import Session, Step
from sim_backend.tools import true_parameters

# Of eighteen values one in a thousand tries lies farther out than this.
GREATEST_DEVIATION_STD = 4.0
RIGS = Path(__file__).parents[3] / "rigs"
SEED = 5
SESSION = Session(
    (
        Step("tare", TareOptions(0.5)),
        Step("calibrate", CalibrateOptions(4.0)),
        Step("free", FreeOptions(levels=3, dwell_s=0.2, duration_s=3.0)),
        Step("imposed", ImposedOptions(velocities_rad_s=(-20.0, 20.0), commands=2, duration_s=4.0)),
    ),
    place="test",
)


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
    rig = load_rig(RIGS / f"{rig_name}.toml")
    fit = run_session(rig, SESSION, out=tmp_path, seed=SEED).conclusion.fit
    assert fit is not None
    found = {estimate.name: estimate for estimate in fit.estimates}
    truth = true_parameters(rig.simulated, seed=SEED, place="", command_unit=rig.command.unit)
    assert set(found) == set(truth)
    for name, (true, unit) in truth.items():
        estimate = found[name]
        assert (estimate.unit, estimate.status) == (unit, Status.VALID)
        assert 0.0 < abs(estimate.value - true) < GREATEST_DEVIATION_STD * estimate.std, name
    least, most = current_known_to
    for name in ("torque_constant", "amplifier_gain"):
        assert least < found[name].std / found[name].value < most, name
