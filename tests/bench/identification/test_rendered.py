"""The law at a port, from torque and motion as they are read: against bodies that scipy moves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter
from scipy.stats import binom

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.rendered import RENDER, RENDERED, Rendered, law_text, rendered
from norton_bench.procedures.waves import multisine
from norton_bench.records import LAW, MOTION, NO_DEVICE_TIME, TICK, TORQUE, Event, Measured, SegmentInfo
from norton_bench.segments import ZERO_TORQUE, Admittance, Use

TICK_S = 1e-3
LAWS = (Admittance(5e-4, 2e-2), Admittance(5e-4, 2e-2, 0.5), Admittance(5e-5, 5e-2))
TORQUE_LATE_S, MOTION_LATE_S, COUNT_RAD = 0.9e-3, 0.3e-3, 2 * np.pi / 2**17
LATE = TORQUE_LATE_S - MOTION_LATE_S


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
    segment = SegmentInfo(0, RENDER, RENDERED, Use.PREPARE, "admittance", start_ns, end_ns)
    return Measured(
        ticks=ticks,
        motion=motion,
        load_motion=motion,
        torque=sensed,
        segments=(segment,),
        events=(Event(end_ns + 1, LAW, law_text(law, LATE)),),
    )


def one(measured: Measured) -> Rendered:
    (result,) = rendered(measured, TICK_S)
    return result


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_intervals_hold_the_law(law: Admittance) -> None:
    """Of thirty records and three values each; the share that chance leaves in one of a thousand tests."""
    results = [one(readings(law, seed)) for seed in range(30)]
    true = np.array(results[0].wanted)
    errors = np.array([each.measured for each in results]) - true
    half = np.array([each.half for each in results])
    assert np.all(np.abs(errors[:, :2]) < [5e-5, 1e-3])
    assert np.count_nonzero(np.abs(errors) < half) >= binom.ppf(1e-3, errors.size, 0.93)
    assert np.sqrt(np.mean((errors / half) ** 2)) > 0.25  # nor far wider than the errors


def test_what_the_law_leaves_is_the_noise_below_30_hz() -> None:
    result = one(readings(LAWS[1], 1))
    assert result.asked == LAWS[1]
    assert result.off_nm == pytest.approx(result.left_nm, rel=0.2)
    assert result.left_nm < 1e-3  # of 1 mN m a reading, with a bandwidth of 500 Hz
    assert result.torque_nm == pytest.approx(np.std(port_torque(1)), rel=0.05)


def test_another_law_than_the_one_asked_for_leaves_torque() -> None:
    measured = readings(LAWS[0], 1)
    asked = Admittance(LAWS[0].mass_kgm2, 2 * LAWS[0].damping_nms_rad)
    events = tuple(replace(each, text=law_text(asked, LATE)) for each in measured.events)
    result = one(replace(measured, events=events))
    assert result.wanted == (5e-4, 4e-2, 0.0)
    assert result.measured[1] == pytest.approx(2e-2, rel=0.02)
    assert result.off_nm > 5 * result.left_nm


def test_zero_torque_explains_none_of_it() -> None:
    measured = readings(LAWS[0], 1)
    result = one(replace(measured, events=(Event(measured.segments[0].end_ns, LAW, law_text(ZERO_TORQUE, LATE)),)))
    assert result.off_nm == result.torque_nm


def test_a_step_that_did_not_end_has_no_law() -> None:
    assert rendered(replace(readings(LAWS[0], 1), events=()), TICK_S) == ()


def test_less_than_a_second_shows_nothing() -> None:
    with pytest.raises(ExperimentError, match="the law acted for less than a second"):
        one(readings(LAWS[0], 1, duration_s=0.9))
