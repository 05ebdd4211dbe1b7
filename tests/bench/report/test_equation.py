"""The model as equations: what is printed is what the network computes with."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.models.parameters import Status
from norton_bench.report.facts_tables import DIGITS, model_of
from norton_bench.result import Result
from tests.bench.report.test_words import read_back

NAMES = {"ωN": "source_velocity", "dτm/dt": "amplifier", "τ": "impedance", "dφ/dt": "contact"}


def told(full: Result) -> dict[str, str]:
    """The right side of each equation with its values, by its left side."""
    assert full.fit is not None
    lines = model_of(full.fit, "N*m").lines
    return dict(line.values.split(" = ", 1) for line in lines)


def test_the_printed_source_gives_the_networks_velocity(full: Result) -> None:
    """Evaluated as a reader would, with the sign that the page prescribes."""
    assert full.network is not None
    above, _, under = told(full)["ωN"].partition(" / ")
    gain, friction = (read_back(part.removesuffix("·c")) for part in above.strip("()").split(" ∓ "))
    for command in (-0.08, 0.05):
        expected = (gain * command - np.sign(command) * friction) / read_back(under)
        assert full.network.source_velocity(command) == pytest.approx(expected, rel=10.0**-DIGITS)


def test_every_parameter_stands_in_the_equations(full: Result) -> None:
    assert set(told(full)) == set(NAMES)
    assert told(full)["τ"] == "τm − 5.000·10⁻⁵·dω/dt − 0.001000·ω − 10.00·φ − 0.01000·dφ/dt"
    assert told(full)["dτm/dt"] == "600.0·(0.9000·c − τm)"
    assert told(full)["dφ/dt"] == "ω − (10.00 / 0.02000)·|ω|·φ"


def test_what_is_not_known_stays_a_symbol(full: Result) -> None:
    assert full.fit is not None
    unknown = tuple(
        replace(each, status=Status.AT_BOUND) if each.name == "presliding_damping" else each
        for each in full.fit.estimates
    )
    lines = model_of(replace(full.fit, estimates=unknown), "N*m").lines
    assert lines[2].values.endswith("− σ1·dφ/dt")


def test_a_negative_value_stands_in_brackets(full: Result) -> None:
    assert full.fit is not None
    turned = tuple(
        replace(each, value=-each.value) if each.name == "torque_gain" else each for each in full.fit.estimates
    )
    assert "((−0.9000)·c − τm)" in model_of(replace(full.fit, estimates=turned), "N*m").lines[0].values


def test_without_torque_the_scale_is_said_to_be_open(full: Result) -> None:
    assert full.fit is not None
    network = full.fit.network.with_provenance({"scale": "free motion only"})
    model = model_of(replace(full.fit, network=network), "A")
    assert "one common factor" in model.remark
    assert ("τm", "torque of the motor [A]") in model.variables
    assert model_of(full.fit, "N*m").remark == ""
