"""The least damping of a virtual body: what the certificates say about it, about less of it and about more."""

from dataclasses import replace
from math import isnan

import pytest

from norton_bench.control.renderable import MASSES, STIFFNESSES, least_damping, overview
from norton_bench.control.rendering import rendering
from norton_bench.segments import Admittance
from tests.bench.control.plant import PlantSettings
from tests.bench.control.runs import TICK_S, calibrated
from tests.bench.control.test_rendering import left_at_rest_nm

CALIBRATION = calibrated(PlantSettings())
BODIES = [(5e-4, 0.0), (1e-3, 0.0), (1e-3, 1.0), (5e-3, 0.5), (8e-5, 0.0)]


def renders(mass_kgm2: float, damping_nms_rad: float, stiffness_nm_rad: float) -> bool:
    return not rendering(CALIBRATION, TICK_S, Admittance(mass_kgm2, damping_nms_rad, stiffness_nm_rad)).unstable


@pytest.mark.parametrize(("mass_kgm2", "stiffness_nm_rad"), BODIES)
def test_with_the_least_damping_a_body_is_rendered_and_with_less_it_is_not(
    mass_kgm2: float, stiffness_nm_rad: float
) -> None:
    least = least_damping(CALIBRATION, TICK_S, mass_kgm2, stiffness_nm_rad)
    assert least > 0.0
    assert renders(mass_kgm2, least, stiffness_nm_rad)
    assert not renders(mass_kgm2, 0.9 * least, stiffness_nm_rad)
    assert all(renders(mass_kgm2, more * least, stiffness_nm_rad) for more in (1.1, 1.5, 3.0, 10.0))


def test_a_body_that_needs_no_damping_is_rendered_without() -> None:
    mass_kgm2 = 8.0 * CALIBRATION.inertia_kgm2
    assert least_damping(CALIBRATION, TICK_S, mass_kgm2, 10.0) == 0.0
    assert all(renders(mass_kgm2, damping_nms_rad, 10.0) for damping_nms_rad in (0.0, 1e-3, 1e-2, 0.1, 1.0))


@pytest.mark.parametrize(("share", "stiffness_nm_rad"), [(2.0, 10.0), (8.0, 10.0), (4.0, 0.0), (8.0, 1.0), (16.0, 0.0)])
def test_with_the_least_damping_a_body_comes_to_rest(share: float, stiffness_nm_rad: float) -> None:
    """On an independent simulation, with its friction, after a kick; also those that need none."""
    mass_kgm2 = share * CALIBRATION.inertia_kgm2
    least = least_damping(CALIBRATION, TICK_S, mass_kgm2, stiffness_nm_rad)
    assert left_at_rest_nm(Admittance(mass_kgm2, least, stiffness_nm_rad)) < 1e-3


def test_the_overview_has_the_scale_of_the_bench() -> None:
    result = overview(CALIBRATION, TICK_S)
    assert len(result.least_nms_rad) == len(result.masses_kgm2) == len(MASSES)
    assert {len(row) for row in result.least_nms_rad} == {len(STIFFNESSES)}
    assert result.stiffnesses_nm_rad == (0.0, 0.1, 1.0, 10.0)  # a sensor of some 200 N m/rad
    place = result.masses_kgm2.index(float(f"{4.0 * CALIBRATION.inertia_kgm2:.2g}"))
    assert result.least_nms_rad[place][0] == least_damping(CALIBRATION, TICK_S, result.masses_kgm2[place])
    assert not any(isnan(each) for each in result.least_nms_rad[-1])


def test_where_the_delay_is_long_no_damping_will_do() -> None:
    late = replace(CALIBRATION, command_delay_s=CALIBRATION.command_delay_s + 12e-3)
    assert isnan(least_damping(late, TICK_S, CALIBRATION.inertia_kgm2))
