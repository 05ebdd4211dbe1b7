"""An identified motor that was written as equations, read back from them."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from norton_bench.models.network import NortonNetwork
from norton_bench.models.terms import TERMS, Factor, NetworkTerm, Term
from norton_bench.networks.expressions import Equations
from norton_bench.networks.kinds import NoConversionError
from norton_bench.networks.motor import as_equations
from norton_bench.networks.nonlinear import NonlinearNetwork

PLAIN = ("beta", "gain", "Im", "B", "s", "sigma_0", "sigma_1")
# Values are the same where they differ by no more than rounding.
ROUNDING = 1e-12


def motor_of(network: NonlinearNetwork) -> NortonNetwork | None:
    """The motor whose equations these are; None for any other network.

    Told by writing the motor out again: equations of another meaning are never taken for it. What the equations do not
    have (intervals, drift, the ranges it was seen to hold with) is not there.
    """
    values = {**network.source.parameters, **network.connection.parameters}
    if set(network.command_units) != {"c"} or not set(PLAIN) <= set(values):
        return None
    try:
        motor = _with_terms(_plain(values, network), values, _texts(network))
        again = as_equations(motor, network.kind, network.form)
    except (ValueError, ZeroDivisionError, NoConversionError):
        return None
    return motor if _same(network, again) else None


def _plain(values: Mapping[str, float], network: NonlinearNetwork) -> NortonNetwork:
    return NortonNetwork(
        torque_gain=values["gain"],
        amplifier_bandwidth_rad_s=values["beta"],
        inertia_kgm2=values["Im"],
        viscous_damping_nms_rad=values["B"],
        coulomb_torque_nm=values["sigma_0"] / values["s"],
        presliding_stiffness_nm_rad=values["sigma_0"],
        presliding_damping_nms_rad=values["sigma_1"],
        command_unit=network.command_units["c"],
        provenance=network.provenance,
    )


def _texts(network: NonlinearNetwork) -> str:
    parts = (network.source, network.connection)
    return "\n".join(text for part in parts for text in (*part.outputs.values(), *part.rates.values()))


def _with_terms(motor: NortonNetwork, values: Mapping[str, float], texts: str) -> NortonNetwork:
    """The motor with the terms whose parameters and waves are among the equations'."""
    own = {name: value for name, (value, _) in motor.parameters().items()}
    terms = [
        NetworkTerm(term.name, _absolute(term, [values[name] for name in names], own), _periods(names[0], texts))
        for term in TERMS
        for names in _names(term, values)
    ]
    return replace(motor, terms=tuple(terms))


def _names(term: Term, values: Mapping[str, float]) -> Iterator[list[str]]:
    """What its parameters are called in the equations, of each time that they have it."""
    if term.name == "cogging":
        numbers = (number for number in range(len(values)) if f"cogging_{number}_0" in values)
        yield from ([f"cogging_{number}_{place}" for place in range(2)] for number in numbers)
        return
    names = [f"{term.name}_{place}" for place in range(len(term.parameters))]
    if term.factor is Factor.JOINT:
        names = ["k", "d", "J", "half"] if "half" in values else ["k", "d", "J"]
        names = names if len(names) == len(term.parameters) else []
    elif term.name == "saturation":
        names = ["kappa"]
    if names and set(names) <= set(values):
        yield names


def _absolute(term: Term, values: list[float], motor: Mapping[str, float]) -> tuple[float, ...]:
    """Values in the units of the table of terms; the equations have those of factors over what these factors change."""
    if term.factor is Factor.JOINT:
        return tuple(2.0 * value if place == 3 else value for place, value in enumerate(values))
    pairs = zip(term.parameters, values, strict=True)
    return tuple(
        value * motor[each.over] if each.over and term.factor is not Factor.TORQUE else value for each, value in pairs
    )


def _periods(name: str, texts: str) -> float:
    """How often its wave comes in a turn, as the cosine that it is multiplied with says; 0 for what is no wave."""
    found = re.search(rf"\b{name} ?\* ?cos\(([\d.e+-]+) ?\*", texts)
    if found is None:
        return 0
    return float(found[1]) if set(found[1]) & set(".e") else int(found[1])


def _same(one: NonlinearNetwork, other: NonlinearNetwork) -> bool:
    """The same equations, with values that are the same but for rounding."""
    steps = np.isclose(one.step_s, other.step_s, rtol=ROUNDING, atol=0.0)
    alike = (one.kind, one.form, one.joined_linearly) == (other.kind, other.form, other.joined_linearly)
    parts = ((one.source, other.source), (one.connection, other.connection))
    return bool(steps) and alike and not one.domain and all(_equal(mine, its) for mine, its in parts)


def _equal(one: Equations, other: Equations) -> bool:
    if (one.inputs, one.outputs, one.rates, one.start) != (other.inputs, other.outputs, other.rates, other.start):
        return False
    names = sorted(one.parameters)
    if set(names) != set(other.parameters):
        return False
    mine, its = ([part.parameters[name] for name in names] for part in (one, other))
    return np.allclose(mine, its, rtol=ROUNDING, atol=0.0)
