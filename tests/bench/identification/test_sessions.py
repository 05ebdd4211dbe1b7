"""Several fits as one: of benches that are the same, of one that has changed, and of fits that lack something."""

import re
from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.bootstrap import DRAWS
from norton_bench.identification.judged_fit import fit
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.identification.results import FitResult
from norton_bench.identification.sessions import SessionFit, differing, together
from norton_bench.models.parameters import Estimate, Status
from norton_bench.models.terms import NetworkTerm
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import TICK_S, Truth

pytestmark = pytest.mark.long

# Half of the usual number: each session's intervals are as wide as so few make them.
FEWER_DRAWS = DRAWS // 2


def session(seed: int, truth: Truth | None = None) -> FitResult:
    rng = np.random.default_rng([seed, 11])
    plan = synthetic.imposed_parts(synthetic.Plan(), truth or Truth(), rng, multisine_s=8.0)
    measured = synthetic.run(plan, truth or Truth(), synthetic.Bench(), seed)
    return fit(measured, command_unit="N*m", tick_s=TICK_S, draws=FEWER_DRAWS)


@pytest.fixture(scope="module")
def alike() -> tuple[SessionFit, ...]:
    return tuple(SessionFit(f"{seed}.mcap", session(seed)) for seed in (1, 2, 3, 4))


@pytest.fixture(scope="module")
def worn() -> SessionFit:
    return SessionFit("worn.mcap", session(5, replace(Truth(), viscous_damping=1.1e-3)))


def changed(fitted: SessionFit, name: str, **changes: object) -> SessionFit:
    estimates = tuple(replace(each, **changes) if each.name == name else each for each in fitted.fit.estimates)
    return replace(fitted, fit=replace(fitted.fit, estimates=estimates))


def test_the_same_bench_does_not_differ_and_is_known_better(alike: tuple[SessionFit, ...]) -> None:
    found = together(alike, "N*m")
    assert differing(found.spreads) == ()
    first, *others = found.verdict
    assert first == "No parameter differs between sessions by more than their own intervals allow."
    assert all("without the term cogging" in sentence for sentence in others)  # of a size that some fits just see
    assert [each.name for each in found.estimates] == [each.name for each in alike[0].fit.estimates]
    for estimate in found.estimates:
        assert estimate.status is Status.VALID
        assert abs(estimate.value - getattr(Truth(), estimate.name)) < 3 * estimate.std, estimate


def test_an_error_that_every_session_makes_stays(alike: tuple[SessionFit, ...]) -> None:
    found = {each.name: each for each in together(alike, "N*m").estimates}
    repeated = [fitted.fit.simulated.repeated_std["presliding_stiffness"] for fitted in alike]
    assert np.mean(repeated) > 0.0  # of a bias that is more than chance, only about its own size is known
    assert found["presliding_stiffness"].std >= 0.98 * np.mean(repeated)


def test_a_bench_that_changed_is_named(alike: tuple[SessionFit, ...], worn: SessionFit) -> None:
    found = together([*alike[:3], worn], "N*m")
    assert differing(found.spreads) == ("viscous_damping",)
    assert re.search(
        r"differ.*: viscous damping \(standard deviation (4\.9|5|5\.1) %, at most .*\)\. ", found.verdict[0]
    )
    damping = next(each for each in found.estimates if each.name == "viscous_damping")
    assert found.spreads["viscous_damping"].between_std == pytest.approx(5e-5, rel=0.05)  # of 1, 1, 1 and 1.1e-3
    assert damping.std > 20 * found.spreads["viscous_damping"].within_std
    assert abs(damping.value - 1.025e-3) < 1e-5


def test_the_network_holds_the_combined_values_and_deviations(alike: tuple[SessionFit, ...], worn: SessionFit) -> None:
    found = together([*alike[:3], worn], "N*m")
    assert found.network is not None
    own = {each.name: each for each in found.estimates}
    covariance = np.array(found.network.covariance)
    assert found.network.covariance_names == PHYSICAL
    assert found.network.viscous_damping_nms_rad == own["viscous_damping"].value
    assert found.network.torque_constant == own["torque_constant"].value
    assert np.sqrt(np.diag(covariance)) == pytest.approx([own[name].std for name in PHYSICAL])
    scale = np.sqrt(np.diag(covariance))
    assert np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min() > 0
    # What differs between sessions follows nothing else; what does not keeps the correlations of each session.
    correlation, each = covariance / np.outer(scale, scale), np.array(alike[0].fit.network.covariance)
    deviation = np.sqrt(np.diag(each))
    assert np.abs(correlation[PHYSICAL.index("viscous_damping")]).max() == pytest.approx(1.0)
    assert np.sort(np.abs(correlation[PHYSICAL.index("viscous_damping")]))[-2] < 0.05
    first, second = PHYSICAL.index("amplifier_bandwidth"), PHYSICAL.index("inertia")
    assert correlation[first, second] == pytest.approx((each / np.outer(deviation, deviation))[first, second], abs=0.25)


def test_what_is_not_valid_in_a_session_takes_no_part(alike: tuple[SessionFit, ...]) -> None:
    far = changed(alike[1], "inertia", value=1.0, status=Status.UNEXCITED)
    found = together([alike[0], far, alike[2]], "N*m")
    assert len(found.spreads["inertia"].weights) == 2
    assert found.network is not None
    assert found.network.inertia_kgm2 == pytest.approx(Truth().inertia, rel=0.01)
    assert "Left out of 2.mcap, for want of a valid value: inertia." in found.verdict


def test_what_one_session_alone_knows_is_not_settled(alike: tuple[SessionFit, ...]) -> None:
    blind = changed(alike[1], "inertia", status=Status.AT_BOUND)
    found = together([alike[0], blind], "N*m")
    inertia = next(each for each in found.estimates if each.name == "inertia")
    own = alike[0].fit.estimate("inertia")
    assert (inertia.value, inertia.std, inertia.status) == (own.value, own.std, Status.LEARNING)
    assert "inertia" not in found.spreads
    assert found.network is not None
    assert "Known from one session alone, without any spread between sessions: inertia." in found.verdict
    assert "Two sessions tell little of the spread between sessions: record three or more." in found.verdict


def test_what_no_session_knows_has_no_number_and_there_is_no_network(alike: tuple[SessionFit, ...]) -> None:
    blind = [changed(each, "torque_gain", value=np.nan, status=Status.RATIO_ONLY) for each in alike]
    found = together(blind, "N*m")
    gain = found.estimates[0]
    assert np.isnan(gain.value)
    assert gain.status is Status.RATIO_ONLY
    assert found.network is None
    assert "There is no network of all sessions: none has a valid torque gain." in found.verdict


def test_fits_that_did_not_converge_combine_to_nothing(alike: tuple[SessionFit, ...]) -> None:
    lost = [
        replace(each, fit=replace(each.fit, converged=False, estimates=tuple(map(unconverged, each.fit.estimates))))
        for each in alike
    ]
    found = together([*lost[:3], alike[3]], "N*m")
    assert not found.combined
    assert "No parameter is valid in two sessions: nothing was combined." in found.verdict
    assert any("1.mcap, whose fit did not converge" in said for said in found.verdict)


def unconverged(estimate: Estimate) -> Estimate:
    return replace(estimate, status=Status.NOT_CONVERGED)


def test_two_sessions_far_apart_settle_nothing(alike: tuple[SessionFit, ...]) -> None:
    twice = changed(alike[1], "coulomb_torque", value=2 * Truth().coulomb_torque)
    found = together([alike[0], twice], "N*m")
    coulomb = next(each for each in found.estimates if each.name == "coulomb_torque")
    assert coulomb.status is Status.LEARNING  # t(1) is 12.7: the interval is wider than the value
    assert "Uncertain by more than half of the value: coulomb torque; record more sessions." in found.verdict


def test_chance_is_counted_for_every_parameter_looked_at(alike: tuple[SessionFit, ...]) -> None:
    spread = together(alike, "N*m").spreads["inertia"]
    p_values = {"a": 0.004, "b": 0.02, "c": 0.03, "d": 0.9}
    found = differing({name: replace(spread, p=p) for name, p in p_values.items()})
    assert found == ("a",)  # 0.004 · 4 is below 0.05, 0.02 · 3 is not, and 0.03 comes after it


def with_terms(fitted: SessionFit, *terms: NetworkTerm) -> SessionFit:
    """The session as if its fit had found these terms, each known to a tenth."""
    before = fitted.fit.network
    names = [name for term in terms for name in term.named() if term.name != "cogging"]
    values = {name: value for term in terms for name, value in term.named().items()}
    covariance = np.diag([*np.ones(len(PHYSICAL)), *((0.1 * values[name]) ** 2 for name in names)])
    covariance[: len(PHYSICAL), : len(PHYSICAL)] = before.covariance
    network = replace(
        before, terms=terms, covariance_names=(*PHYSICAL, *names), covariance=tuple(map(tuple, covariance.tolist()))
    )
    estimates = [Estimate(name, values[name], 0.1 * abs(values[name]), "1", Status.VALID) for name in names]
    return replace(fitted, fit=replace(fitted.fit, network=network, estimates=(*fitted.fit.estimates, *estimates)))


def test_terms_that_every_session_has_are_combined(alike: tuple[SessionFit, ...]) -> None:
    sizes = (0.10, 0.12, 0.11)
    sessions = [
        with_terms(each, NetworkTerm("asymmetry", (size,)), NetworkTerm("cogging", (size, 0.0), 7 + 0.01 * size))
        for each, size in zip(alike, sizes, strict=False)
    ]
    found = together(sessions, "N*m")
    assert found.network is not None
    asymmetry, cogging = found.network.terms
    own = next(each for each in found.estimates if each.name == "coulomb_asymmetry")
    assert asymmetry.values == (own.value,)
    assert own.value == pytest.approx(0.11, abs=0.003)
    assert cogging.values == pytest.approx((0.11, 0.0))
    assert found.network.covariance_names == (*PHYSICAL, "coulomb_asymmetry")
    assert found.network.covariance[-1][-1] == pytest.approx(own.std**2)
    assert not any("without the term" in sentence for sentence in found.verdict)


def test_a_term_that_only_some_sessions_have_is_named_with_its_cost(alike: tuple[SessionFit, ...]) -> None:
    found = together([with_terms(alike[0], NetworkTerm("asymmetry", (0.3,))), *alike[1:3]], "N*m")
    assert found.network is not None
    assert found.network.terms == ()
    assert found.network.covariance_names == PHYSICAL
    (sentence,) = (each for each in found.verdict if "without the term asymmetry" in each)
    assert re.search(r"In 1\.mcap, being without it costs [\d.]+ % of the torque's rms", sentence)
    assert "coulomb_asymmetry" not in [each.name for each in found.estimates]
