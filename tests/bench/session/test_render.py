"""Virtual bodies on the simulated bench, through frames and bytes."""

from pathlib import Path

import numpy as np
import pytest

from norton_bench.cli import app
from norton_bench.errors import ExitCode, ExperimentError, RigError
from norton_bench.procedures.knowledge import Knowledge, Reducing, only_rendered
from norton_bench.procedures.modulated import modulated
from norton_bench.procedures.options import RenderOptions
from norton_bench.procedures.render import RenderProcedure
from norton_bench.result import Result
from norton_bench.rig.load import load_rig
from norton_bench.segments import ZERO_TORQUE, Admittance, LoadMode, Segment, Use
from norton_bench.session.conclusion import conclude_recording
from norton_bench.session.engine import record_session
from norton_bench.session.schema import load_session
from tests.bench.control.plant import PlantSettings
from tests.bench.control.runs import calibrated

ROOT = Path(__file__).parents[3]
RIGS, SESSION = ROOT / "rigs", ROOT / "sessions" / "virtual-body.toml"
TOO_LIGHT = """
rig = "{rig}"
[[step]]
do = "tare"
duration = "0.5 s"
[[step]]
do = "calibrate"
duration = "4 s"
[[step]]
do = "free"
levels = 3
dwell = "200 ms"
duration = "1 s"
[[step]]
do = "render"
mass = "5e-5 kg*m^2"
"""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    rig, out = load_rig(RIGS / "sim-odrive.toml"), tmp_path_factory.mktemp("rendered")
    recorded = record_session(rig, load_session(SESSION), out=out, seed=11, live=False)
    return conclude_recording(recorded.recording, out)


@pytest.mark.long
def test_the_port_has_the_law_that_was_asked_for(result: Result) -> None:
    """Damping and stiffness; the mass is what the delay makes of it, and measured as such."""
    viscous, spring, wall, nothing = result.rendered
    assert viscous.asked == Admittance(5e-4, 2e-2)
    assert spring.asked == Admittance(5e-4, 2e-2, 0.5)
    assert viscous.measured[1] == pytest.approx(2e-2, rel=0.1)
    assert spring.measured[2] == pytest.approx(0.5, rel=0.02)
    assert wall.asked == Admittance(5e-4, 2e-2, 2.0, wall_rad=0.1)
    assert wall.measured[2] == pytest.approx(2.0, rel=0.05)
    for each in (viscous, spring, wall):
        assert 0.0 < each.measured[0] < 1e-3
        assert each.left_nm <= each.off_nm < 0.4 * each.torque_nm
    assert nothing.asked == ZERO_TORQUE
    assert nothing.torque_nm < 0.1 * viscous.torque_nm


@pytest.mark.long
def test_the_certificate_is_recorded_with_the_plan(result: Result) -> None:
    assert result.measured is not None
    certificates = [event.text for event in result.measured.events if event.text.startswith("render: ")]
    assert len(certificates) == 3
    assert "0.0005 kg*m^2 of mass, 0.02 N*m*s/rad of damping is stable with an actuator of " in certificates[0]


@pytest.mark.long
def test_a_law_beyond_the_bench_is_refused_before_the_load_acts_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "light.toml"
    session.write_text(TOO_LIGHT.format(rig=RIGS / "sim-odrive.toml"), encoding="utf-8")
    code = app.main(["run", str(session), "--no-live", "--out", str(tmp_path / "out")])
    printed = capsys.readouterr()
    assert code == ExitCode.EXPERIMENT_FAILED
    assert "this bench cannot render 5e-05 kg*m^2 of mass: with an actuator that slides the load would" in printed.err
    assert "it can " in printed.err


@pytest.mark.parametrize(
    ("rig", "why"),
    [
        ("sim-free-shaft", "step 'render' needs a load drive to act the virtual body"),
        ("sim-in-situ", "step 'render' needs a torque sensor"),
        ("sim-servo", "the command of this actuator is a position"),
    ],
)
def test_rigs_that_cannot_render_are_told_so(rig: str, why: str) -> None:
    with pytest.raises(RigError, match=why):
        RenderProcedure(RenderOptions()).require(load_rig(RIGS / f"{rig}.toml"))


def test_without_a_calibration_there_is_a_sentence() -> None:
    step = RenderProcedure(RenderOptions(mass_kgm2=5e-4, damping_nms_rad=2e-2))
    with pytest.raises(ExperimentError, match="run the step 'calibrate' before it"):
        step.reductions(Knowledge(load_rig(RIGS / "sim-odrive.toml")))


def test_a_law_of_ones_own_procedure_is_refused_too() -> None:
    """Without offers while the drives are enabled: they would take seconds."""
    known = Knowledge(load_rig(RIGS / "sim-odrive.toml"), calibration=calibrated(PlantSettings()))
    allowed = only_rendered(known)

    def segment(law: Admittance) -> Segment:
        return Segment("own", "own", Use.PREPARE, np.zeros(10), LoadMode.ADMITTANCE, law)

    good = segment(Admittance(5e-4, 2e-2))
    assert allowed(good, None, 0.0, 0.0) is good
    assert allowed(segment(ZERO_TORQUE), None, 0.0, 0.0).admittance == ZERO_TORQUE
    with pytest.raises(ExperimentError, match=r"cannot render 0\.0005 kg\*m\^2 of mass: .* come to rest$"):
        allowed(segment(Admittance(5e-4)), 0.1, 0.0, 0.0)


def test_under_a_modulation_the_certificate_is_the_same() -> None:
    known = Knowledge(load_rig(RIGS / "sim-odrive.toml"), calibration=calibrated(PlantSettings()))
    step = RenderProcedure(RenderOptions(mass_kgm2=5e-4, damping_nms_rad=2e-2))
    under = modulated(step, (0.0, 1.0))
    assert isinstance(under, Reducing)
    assert under.reductions(known) == step.reductions(known) != ()


def test_the_law_is_read_with_its_units() -> None:
    step = load_session(SESSION).steps[4]
    assert step.options.law == Admittance(5e-4, 2e-2, 0.5)
    assert RenderOptions().law == ZERO_TORQUE
