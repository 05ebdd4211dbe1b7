"""Virtual bodies on the simulated bench, through frames and bytes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.cli import app
from norton_bench.errors import ExitCode, ExperimentError, RigError
from norton_bench.identification.rendered import law_of
from norton_bench.procedures.knowledge import Knowledge, Plan, Reducing, only_rendered
from norton_bench.procedures.modulated import modulated
from norton_bench.procedures.options import LawOptions, RenderOptions
from norton_bench.procedures.render import REST_S, RenderProcedure
from norton_bench.records import Measured
from norton_bench.result import Result
from norton_bench.rig.load import load_rig
from norton_bench.segments import GLIDE_S, ZERO_TORQUE, Admittance, LoadMode, Segment, Use
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
def test_from_one_law_to_the_next_the_shaft_is_not_let_go_of(result: Result) -> None:
    """The load turns on at the velocity at which it turned, and acts a spring from where it stood."""
    assert result.measured is not None
    before, change, after = [each for each in result.measured.segments if each.procedure == "render"][:3]
    laws = law_of(before), law_of(change), law_of(after)
    assert laws == (Admittance(5e-4, 2e-2), None, Admittance(5e-4, 2e-2, 0.5))
    assert change.start_ns - before.end_ns < 2e6
    assert after.start_ns - change.end_ns < 2e6
    places = [result.measured.between(each.start_ns, each.end_ns).ticks for each in (before, change, after)]
    before_rad, change_rad, after_rad = (each["reference_position_rad"] for each in places)
    assert np.ptp(before_rad) == np.ptp(np.concatenate([change_rad, after_rad])) == 0.0
    assert change_rad[0] != before_rad[0]
    wishes = np.concatenate([each["wished_load_torque_nm"] for each in places])
    at = len(places[0])
    usual_nm = np.quantile(np.abs(np.diff(wishes[at - 300 : at])), 0.95)
    assert np.max(np.abs(np.diff(wishes[at - 1 : at + 5]))) < 2.0 * usual_nm


def test_laws_on_the_way_to_another_must_be_ones_that_the_bench_can_render() -> None:
    """Both ends can be rendered; a body half as heavy as the last, damped half as much, swings on a contact."""
    known = Knowledge(load_rig(RIGS / "sim-odrive.toml"), calibration=calibrated(PlantSettings()))
    heavy, between = LawOptions(mass_kgm2=1e-2, damping_nms_rad=0.3), LawOptions(mass_kgm2=2e-4, damping_nms_rad=0.3)

    def certificates(*then: LawOptions) -> tuple[str, ...]:
        options = RenderOptions(mass_kgm2=2e-4, damping_nms_rad=5e-3, then=then)
        return RenderProcedure(options).reductions(known)

    assert len(certificates(between, heavy)) == 3
    with pytest.raises(ExperimentError, match=r"^on the way from .* to 0\.01 kg\*m\^2 .* go there by another law$"):
        certificates(heavy)


def test_laws_that_follow_one_another_take_their_time() -> None:
    alone, rig = RenderOptions(duration_s=4.0), load_rig(RIGS / "sim-odrive.toml")
    three = RenderOptions(duration_s=4.0, then=(LawOptions(duration_s=5.0), LawOptions(duration_s=6.0)))
    durations_s = [RenderProcedure(each).duration_s(rig) for each in (alone, three)]
    assert durations_s[1] - durations_s[0] == pytest.approx(5.0 + 6.0 + 4 * REST_S + 2 * GLIDE_S)


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


@pytest.mark.long
@pytest.mark.parametrize("fast", [False, True])
def test_no_law_follows_once_the_shaft_turned_too_fast(fast: bool, result: Result) -> None:
    known = Knowledge(load_rig(RIGS / "sim-odrive.toml"), calibration=calibrated(PlantSettings()))
    plan = RenderProcedure(RenderOptions(mass_kgm2=5e-4, damping_nms_rad=2e-2, then=(LawOptions(),))).plan(known)
    segment = next(plan)
    assert result.measured is not None
    ticks = result.measured.ticks[:3].copy()
    ticks["velocity_rad_s"] = segment.stop_at_velocity_rad_s if fast else 0.0
    following = next_of(plan, replace(result.measured, ticks=ticks))
    assert (following is None) is fast


def next_of(plan: Plan, measured: Measured) -> Segment | None:
    try:
        return plan.send(measured)
    except StopIteration:
        return None


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
    laws = [each.law for each in load_session(SESSION).steps[3].options.laws]
    assert laws == [Admittance(5e-4, 2e-2), Admittance(5e-4, 2e-2, 0.5)]
    assert RenderOptions().law == ZERO_TORQUE
