"""All models of friction, from the simplest on, by their names."""

from norton_bench.errors import UsageError, nearest
from norton_bench.identification.friction.asymmetric import Asymmetric
from norton_bench.identification.friction.laws import (
    CoulombViscous,
    Dahl,
    ElastoPlastic,
    LoadDependent,
    LuGre,
    MaxwellSlip,
    Stribeck,
)
from norton_bench.identification.friction.model import FrictionModel, Path

FAMILY: tuple[FrictionModel, ...] = (
    CoulombViscous(),
    Asymmetric(CoulombViscous(), memory=False),
    LoadDependent(),
    Stribeck(),
    Asymmetric(Stribeck(), memory=False),
    Dahl(),
    ElastoPlastic(),
    LuGre(),
    MaxwellSlip(),
    Asymmetric(ElastoPlastic(), memory=True),
    Asymmetric(MaxwellSlip(), memory=True),
)

# Models that a model becomes for some of its values. All others are friction laws of their own.
CONTAINS = {
    "coulomb-viscous-asymmetric": ("coulomb-viscous",),
    "load-dependent": ("coulomb-viscous",),
    "stribeck": ("coulomb-viscous",),
    "stribeck-asymmetric": ("stribeck", "coulomb-viscous-asymmetric", "coulomb-viscous"),
    # With the least Stribeck velocity its stiction is gone as soon as the shaft moves.
    "lugre": ("dahl",),
    "maxwell-slip": ("stribeck", "coulomb-viscous"),
    "elasto-plastic-asymmetric": ("elasto-plastic",),
    "maxwell-slip-asymmetric": ("maxwell-slip", "stribeck", "coulomb-viscous"),
}


def model(name: str) -> FrictionModel:
    """The member called ``name``. Raises UsageError, with the nearest name, where there is none."""
    by_name = {member.name: member for member in FAMILY}
    if name not in by_name:
        raise UsageError(f'there is no friction model "{name}"; {nearest(name, by_name)}')
    return by_name[name]


def family_for(path: Path) -> tuple[FrictionModel, ...]:
    """Those that can be computed on ``path``: a model that asks for the load only where the load is known."""
    return tuple(member for member in FAMILY if path.load is not None or not isinstance(member, LoadDependent))
