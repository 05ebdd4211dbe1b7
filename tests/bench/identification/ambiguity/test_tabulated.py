"""The three conditions from tables alone: springs, backlash, several places of rest, a port that runs on."""

import re
from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.averages import Mean, Setting, Swept
from norton_bench.identification.exertion_table import ExertionTable
from norton_bench.identification.source_table import SourceLevel, SourceTable
from norton_bench.identification.table_conditions import tabulated_conditions
from tests.bench.identification.tables.springs import HELD, backlash, table

SPACING_RAD = 0.0125  # of the nine places


def unique_zero(exerted, friction_nm=0.0):
    return tabulated_conditions(None, table(exerted, friction_nm))[1]


def sweep(exerted, friction_nm, rising):
    """Slowly from one end of the nine places to the other, with the noise of so many readings."""
    place = np.linspace(-0.05, 0.05, 40)
    noise_nm = 1e-4 * np.random.default_rng(rising).standard_normal(place.size)
    torque_nm = np.array([exerted(each) for each in place]) - (friction_nm if rising else -friction_nm) + noise_nm
    return Swept(HELD, rising, 0.05, (place, torque_nm, np.full(place.size, 2e-4)))


def swept(exerted, friction_nm, held_friction_nm):
    held = table(exerted, held_friction_nm)
    return replace(held, swept=(sweep(exerted, friction_nm, True), sweep(exerted, friction_nm, False)))


def levels(*settled):
    return SourceTable(
        tuple(
            SourceLevel("actuator", Setting(0.1 * k), True, Mean(0.1 * k, 1e-4), Mean(0.0, 1e-4), 0.0, rests, 0.2 + k)
            for k, rests in enumerate(settled)
        )
    )


@pytest.mark.parametrize("width_rad", [0.02, 0.04])
def test_backlash_is_an_interval_of_zeros_with_its_width(width_rad):
    judged = unique_zero(backlash(8.0, width_rad), friction_nm=5e-3)
    assert judged.holds is False
    assert judged.unit == "rad"
    assert judged.value == pytest.approx(width_rad, abs=2e-3)
    assert judged.interval[0] < judged.value < judged.interval[1]
    low_mrad, high_mrad = (float(edge) for edge in re.findall(r"(-?[\d.]+) mrad", judged.why))
    assert [low_mrad, high_mrad] == pytest.approx([-500 * width_rad, 500 * width_rad], abs=2)


@pytest.mark.parametrize("hardening", [0.0, 400.0, 1200.0])  # at the ends no, twice and four times the stiffness
def test_a_spring_that_hardens_is_no_backlash(hardening):
    judged = unique_zero(lambda away: -3.0 * away - hardening * away**3)
    assert judged.holds
    (spacing_mrad,) = re.findall(r"narrower than ([\d.]+) mrad", judged.why)
    assert float(spacing_mrad) == pytest.approx(1e3 * SPACING_RAD, abs=0.3)


def test_what_is_narrower_than_the_places_lie_apart_is_not_called_a_gap():
    judged = unique_zero(backlash(8.0, 0.6 * SPACING_RAD))
    assert judged.holds
    assert judged.interval[1] < SPACING_RAD


def test_a_torque_that_vanishes_at_several_places_has_no_unique_zero():
    judged = unique_zero(lambda away: -0.1 * np.sin(away * np.pi / 0.03))
    assert judged.holds is False
    assert "several places" in judged.why


def test_one_side_alone_cannot_tell():
    one_side = tuple(held for held in table(lambda away: -3.0 * away).held if held.displacement_rad > 0)
    judged = tabulated_conditions(None, ExertionTable(one_side, (), {HELD: Mean(0.5, 1e-5)}))
    assert [each.holds for each in judged] == [None, None, None]


@pytest.mark.parametrize(("settled", "holds"), [((True, True), True), ((False, False), False), ((True, False), None)])
def test_the_free_port_settles_or_not(settled, holds):
    judged = tabulated_conditions(levels(*settled), None)[2]
    assert judged.holds is holds
    assert judged.value == pytest.approx(1.2)


@pytest.mark.parametrize(("held_nm", "holds"), [(0.035, True), (0.0, None), (-0.15, False)])
def test_a_port_that_slides_exerts_what_it_did_when_held_or_not(held_nm, holds):
    """Friction of 0.04 N m while it slides, beside a spring of 0.15; the held port keeps of it what is given."""
    exertion = swept(lambda away: -3.0 * away, 0.04, held_nm)
    judged = tabulated_conditions(None, exertion)[0]
    assert judged.holds is holds
    assert judged.interval[0] <= judged.value <= judged.interval[1]
    (line,) = exertion.lines()
    assert line.sweep.friction.value == pytest.approx(0.04, abs=1e-4)


def test_a_sweep_tells_a_gap_that_places_are_too_few_for():
    exertion = swept(backlash(8.0, 0.01), 2e-3, 0.0)
    judged = tabulated_conditions(None, exertion)[1]
    assert judged.holds is False
    assert judged.value == pytest.approx(0.01, abs=5e-4)
    assert tabulated_conditions(None, replace(exertion, swept=()))[1].holds is True


def test_nothing_tabulated_is_not_judged():
    assert tabulated_conditions(None, None) == ()
