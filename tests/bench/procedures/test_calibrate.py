"""What the controller is told of a contact that the calibration hardly resolves."""

from dataclasses import dataclass, replace
from math import inf

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad
from scipy.stats import truncnorm

from norton_bench.control.design import design_tracking
from norton_bench.errors import ExperimentError
from norton_bench.identification.load import fit_load
from norton_bench.models.parameters import Estimate, Status
from norton_bench.procedures.calibrate import least_sensor_damping_nms_rad, likely_presliding_damping_nms_rad
from tests.bench.control.test_design import CALIBRATION, TICK_S
from tests.bench.identification import synthetic


@dataclass(frozen=True)
class Machine:
    """A fit, of which only one value matters here."""

    value: float
    std: float

    def estimate(self, name: str) -> Estimate:
        assert name == "presliding_damping"
        return Estimate(name, self.value, self.std, "N*m*s/rad", Status.VALID)


@pytest.mark.parametrize(("value", "std"), [(0.01, 1e-4), (0.0, 0.006), (-0.004, 0.006), (0.003, 0.006)])
def test_a_damping_is_the_mean_of_what_it_may_be(value: float, std: float) -> None:
    expected = truncnorm.mean(-value / std, np.inf, loc=value, scale=std)
    assert likely_presliding_damping_nms_rad(Machine(value, std)) == pytest.approx(expected, rel=1e-6)


def test_a_negative_damping_is_wrong_by_as_much_as_that() -> None:
    """−3.2 ± 1.3 mN·m·s/rad was found on a bench with 4.6: the two encoders were not read at the same time."""
    expected = truncnorm.mean(1.0, np.inf, loc=-3.2e-3, scale=3.2e-3)
    assert likely_presliding_damping_nms_rad(Machine(-3.2e-3, 1.3e-3)) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("std", [0.0, inf])
def test_without_a_deviation_it_is_the_value_that_was_found(std: float) -> None:
    assert likely_presliding_damping_nms_rad(Machine(0.01, std)) == 0.01
    assert likely_presliding_damping_nms_rad(Machine(-0.01, std)) == 0.0


@pytest.mark.long
def test_no_feedback_is_stable_with_a_contact_that_rings_for_ever_but_with_a_likely_one() -> None:
    """Light machines with 4096 counts: the contact of the load is a third of a count long."""
    coarse = replace(
        CALIBRATION,
        torque_gain=1.167,
        amplifier_bandwidth_rad_s=1080.0,
        inertia_kgm2=7.1e-5,
        viscous_damping_nms_rad=7.1e-4,
        coulomb_torque_nm=2.4e-3,
        presliding_stiffness_nm_rad=13.0,
        presliding_damping_nms_rad=0.0,
        command_delay_s=3.3e-4,
        measurement_delay_s=0.0,
        motion_delay_s=-1.4e-5,
        sensor_stiffness_nm_rad=57.8,
        sensor_damping_nms_rad=4.1e-4,
        torque_noise_nm=9.6e-4,
        position_resolution_rad=1.53e-3,
        position_jitter_s=6.9e-5,
        actuator_inertia_kgm2=4.98e-5,
    )
    with pytest.raises(ExperimentError, match="no feedback, however gentle"):
        design_tracking(coarse, TICK_S)
    likely = likely_presliding_damping_nms_rad(Machine(0.0, 5.7e-3))
    assert design_tracking(replace(coarse, presliding_damping_nms_rad=likely), TICK_S).gentler <= 8.0


def test_the_spring_is_told_damped_by_no_more_than_is_sure() -> None:
    """18 ± 6 mN·m·s/rad were found of a sensor that has 10: a feedback for 18 grew within 0.2 s."""
    fit = fit_load(synthetic.calibration(1, duration_s=4.0), TICK_S)
    sure, unsure = (replace(fit, sensor_damping_nms_rad=0.0184, sensor_damping_std_nms_rad=std) for std in (0.006, 0.1))
    mobility = 1.0 / fit.result.network.inertia_kgm2
    joints = stats.lognorm(0.88, scale=0.028 * 2.0 * np.sqrt(fit.sensor_stiffness_nm_rad / mobility))

    def weight(damping: float) -> float:
        return float(joints.pdf(damping) * stats.norm.pdf(damping, 0.0184, 0.006))

    least = least_sensor_damping_nms_rad(sure, None)
    assert least < 0.01
    assert quad(weight, 0.0, least)[0] == pytest.approx(0.05 * quad(weight, 0.0, 0.05)[0], rel=0.02)
    assert least_sensor_damping_nms_rad(unsure, None) == pytest.approx(joints.ppf(0.05), rel=0.01)


def test_a_sensor_is_damped_no_less_than_a_bolted_joint() -> None:
    fit = replace(fit_load(synthetic.calibration(1, duration_s=4.0), TICK_S), sensor_damping_nms_rad=1e-6)
    sure = replace(fit, sensor_damping_std_nms_rad=1e-6)
    critical = 2.0 * np.sqrt(fit.sensor_stiffness_nm_rad * fit.result.network.inertia_kgm2)
    assert least_sensor_damping_nms_rad(sure, None) == pytest.approx(0.005 * critical)
