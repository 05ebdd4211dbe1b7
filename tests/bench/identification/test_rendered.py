"""The law at a port, from torque and motion as they are read: against bodies that scipy moves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete, lfilter
from scipy.stats import binom

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.rendered import Rendered, law_of, name_of, rendered
from norton_bench.procedures.waves import multisine
from norton_bench.records import MOTION, NO_DEVICE_TIME, TICK, TORQUE, Measured, SegmentInfo
from norton_bench.segments import RENDER, ZERO_TORQUE, Admittance, Use

TICK_S = 1e-3
LAWS = (Admittance(5e-4, 2e-2), Admittance(5e-4, 2e-2, 0.5), Admittance(5e-5, 5e-2))
TORQUE_LATE_S, MOTION_LATE_S, COUNT_RAD = 0.9e-3, 0.3e-3, 2 * np.pi / 2**17
LATE_S = TORQUE_LATE_S - MOTION_LATE_S


def port_torque(seed: int, duration_s: float = 8.0) -> FloatArray:
    wave = multisine(duration_s, TICK_S, low_hz=0.5, high_hz=15.0, seed=seed, slope=-0.25)
    return 0.03 * wave


def readings(law: Admittance, seed: int, duration_s: float = 8.0, noise_nm: float = 1e-3) -> Measured:
    """A body of this law under a torque that is read late and with noise; its position is read in counts."""
    rng = np.random.default_rng(seed)
    torque = port_torque(seed, duration_s)
    count = len(torque)
    fine_s = np.arange(10 * count) * 0.1 * TICK_S
    force = np.interp(fine_s, np.arange(count) * TICK_S, torque)
    body = ([1.0], [law.mass_kgm2, law.damping_nms_rad, law.stiffness_nm_rad])
    above, below, _ = cont2discrete(body, 0.1 * TICK_S, method="foh")  # exact: the force is straight between
    turned = lfilter(above[0], below, force)
    start_ns = 5_000_000_000
    stamps = start_ns + np.arange(count) * 1_000_000

    def table(kind: np.dtype, column: str, values: FloatArray, late_s: float) -> np.ndarray:
        rows = np.zeros(count, kind)
        rows["arrival_ns"] = stamps + round(late_s * 1e9) + rng.integers(0, 100_000, count)
        rows["device_ns"] = NO_DEVICE_TIME
        rows["sequence"] = np.arange(count)
        rows[column] = values
        return rows

    motion = table(MOTION, "position_rad", np.floor(turned[::10] / COUNT_RAD) * COUNT_RAD, MOTION_LATE_S)
    sensed = table(TORQUE, "torque_nm", torque + noise_nm * rng.standard_normal(count), TORQUE_LATE_S)
    sensed["valid"] = True
    ticks = np.zeros(count, TICK)
    ticks["tick_ns"] = stamps
    end_ns = int(stamps[-1]) + 1_000_000
    segment = SegmentInfo(0, RENDER, name_of(law), Use.PREPARE, "admittance", start_ns, end_ns)
    return Measured(
        ticks=ticks,
        motion=motion,
        load_motion=motion,
        torque=sensed,
        segments=(segment,),
    )


@pytest.fixture(autouse=True)
def calibrated(monkeypatch: pytest.MonkeyPatch) -> None:
    """The calibration knows by how much torque is read later than motion; there is none in these records."""
    fit = SimpleNamespace(result=SimpleNamespace(motion_delay_s=-LATE_S))
    monkeypatch.setattr("norton_bench.identification.rendered.fit_load", lambda *_: fit)


def named(measured: Measured, law: Admittance) -> Measured:
    """The same readings, as if another law had been asked for."""
    return replace(measured, segments=tuple(replace(each, name=name_of(law)) for each in measured.segments))


def one(measured: Measured) -> Rendered:
    (result,) = rendered(measured, TICK_S)
    return result


@pytest.mark.parametrize("duration_s", [8.0, 3.5])
@pytest.mark.parametrize("law", LAWS, ids=str)
def test_intervals_hold_the_law(law: Admittance, duration_s: float) -> None:
    """Of thirty records and three values each; the share that chance leaves in one of a thousand tests."""
    results = [one(readings(law, seed, duration_s)) for seed in range(30)]
    true = np.array(results[0].asked.values)
    errors = np.array([each.measured for each in results]) - true
    half = np.array([each.half for each in results])
    assert np.all(np.abs(errors[:, :2]) < [1e-4, 2e-3])
    assert np.count_nonzero(np.abs(errors) < half) >= binom.ppf(1e-3, errors.size, 0.93)
    assert np.sqrt(np.mean((errors / half) ** 2)) > 0.25  # nor far wider than the errors


def test_what_the_law_leaves_is_the_noise_below_30_hz() -> None:
    result = one(readings(LAWS[1], 1))
    assert result.asked == LAWS[1]
    assert result.off_nm == pytest.approx(result.left_nm, rel=0.2)
    assert result.left_nm < 1e-3  # of 1 mN m a reading, with a bandwidth of 500 Hz
    assert result.torque_nm == pytest.approx(np.std(port_torque(1)), rel=0.05)


def test_another_law_than_the_one_asked_for_leaves_torque() -> None:
    asked = Admittance(LAWS[0].mass_kgm2, 2 * LAWS[0].damping_nms_rad)
    result = one(named(readings(LAWS[0], 1), asked))
    assert result.asked.values == (5e-4, 4e-2, 0.0)
    assert result.measured[1] == pytest.approx(2e-2, rel=0.02)
    assert result.off_nm > 5 * result.left_nm


def test_zero_torque_explains_none_of_it() -> None:
    result = one(named(readings(LAWS[0], 1), ZERO_TORQUE))
    assert result.off_nm == pytest.approx(result.torque_nm, rel=0.01)


@pytest.mark.long
def test_the_stiffness_of_a_wall_is_measured_in_it() -> None:
    """A body that scipy's solver moves into it and out of it."""
    law = Admittance(5e-4, 2e-2, 0.5, wall_rad=0.01)
    results = [one(of_wall(law, seed)) for seed in range(10)]
    errors = np.array([each.measured for each in results]) - np.array(law.values)
    half = np.array([each.half for each in results])
    assert np.all(np.abs(errors[:, 2]) < 0.02)
    assert np.count_nonzero(np.abs(errors) < half) >= binom.ppf(1e-3, errors.size, 0.93)
    assert results[0].asked == law


def test_a_wall_that_the_shaft_does_not_come_to_has_no_stiffness() -> None:
    law = Admittance(5e-4, 2e-2, 0.5, wall_rad=50.0)
    assert one(of_wall(law, 1)).shortcoming == "the shaft did not come to the wall"


def of_wall(law: Admittance, seed: int) -> Measured:
    """The readings of a body with a wall, which begins a little before it."""
    torque = port_torque(seed)
    time_s, start_rad = np.arange(len(torque)) * TICK_S, 1.7

    def moved(at_s: float, state: FloatArray) -> list[float]:
        turned_rad, velocity_rad_s = state
        pull = np.interp(at_s, time_s, torque) - law.damping_nms_rad * velocity_rad_s
        return [velocity_rad_s, (pull - law.stiffness_nm_rad * max(turned_rad - law.wall_rad, 0.0)) / law.mass_kgm2]

    path = solve_ivp(moved, (0.0, time_s[-1]), [0.0, 0.0], t_eval=time_s, rtol=1e-8, atol=1e-10, max_step=TICK_S).y[0]
    measured = named(readings(law, seed), law)
    motion, ticks = measured.load_motion.copy(), measured.ticks.copy()
    motion["position_rad"] = np.floor((start_rad + path) / COUNT_RAD) * COUNT_RAD
    ticks["reference_position_rad"] = start_rad
    return replace(measured, load_motion=motion, motion=motion, ticks=ticks)


def test_a_law_that_acted_too_briefly_has_a_reason_instead_of_values() -> None:
    result = one(readings(LAWS[0], 1, duration_s=2.9))
    assert result.shortcoming == "the law acted for 2.9 s, and 3 s are needed"
    assert np.isnan([*result.measured, *result.half, result.off_nm]).all()


def test_nothing_read_is_a_reason_too() -> None:
    measured = readings(LAWS[0], 1)
    assert "next to nothing was read" in one(replace(measured, load_motion=measured.load_motion[:5])).shortcoming
    assert one(replace(measured, torque=measured.torque[:0])).shortcoming == "no torque was read"


def test_without_a_calibration_damping_and_mass_cannot_be_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise ExperimentError("nothing was calibrated")

    monkeypatch.setattr("norton_bench.identification.rendered.fit_load", fails)
    assert one(readings(LAWS[0], 1)).shortcoming == "the calibration tells no delays: nothing was calibrated"


@pytest.mark.parametrize(
    "law", [*LAWS, ZERO_TORQUE, Admittance(1 / 3e3, 1e-9, 123.456), Admittance(1.0, 2.0, 3.0, wall_rad=-0.1)], ids=str
)
def test_a_segment_bears_its_law(law: Admittance) -> None:
    segment = SegmentInfo(0, RENDER, name_of(law), Use.PREPARE, "admittance", 0, 1)
    assert law_of(segment) == law
    assert law_of(replace(segment, procedure="free")) is None
    assert law_of(replace(segment, name="modulate")) is None
