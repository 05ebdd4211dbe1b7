"""What was logged at the motor's side of a gear, as it is at the joint; and a load of known mass and length."""

from collections.abc import Mapping

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.logs.column_map import ColumnMap

G_M_S2 = 9.80665
Place = tuple[str, str]


def at_joint(
    place: str, columns: Mapping[str, FloatArray], givens: Mapping[Place, float], column_map: ColumnMap
) -> tuple[dict[str, FloatArray], dict[Place, float]]:
    """Columns (n,) and known numbers at the joint: motions of the motor over the ratio, its torques times the ratio.

    Raises UsageError for a ratio of zero, or none although a column is of the motor's side.
    """
    known = dict(givens)
    _add_point_mass(known)
    geared = [name for name, section in column_map.mapped().items() if section.side == "motor" and name in columns]
    if not geared:
        return dict(columns), known
    ratio = known.get(("actuator", "gear_ratio"))
    if not ratio:
        raise UsageError(
            f"{place}: {geared[0]} is of the motor's side, but [actuator] gear_ratio of {column_map.place} is "
            f"{'missing' if ratio is None else 'zero'}; write it, such as gear_ratio = 50"
        )
    result = dict(columns)
    for name in geared:
        if name in MOTIONS:
            result[name] = columns[name] / ratio
        elif name in EXERTIONS:
            result[name] = columns[name] * ratio
    for key in [each for each in known if GEARED.get(each) in geared]:
        known[key] *= ratio
    return result, known


MOTIONS = ("position", "velocity", "link_position", "goal")
EXERTIONS = ("exertion", "load")
# Known numbers that are of the side of a column: they are per radian of the motor, or in its torque.
GEARED: Mapping[Place, str] = {
    ("actuator", "torque_gain"): "command",
    ("loop", "proportional"): "position",
    ("loop", "derivative"): "position",
}


def _add_point_mass(known: dict[Place, float]) -> None:
    """m g l and, where no inertia is given, m l²."""
    mass_kg, length_m = known.pop(("load", "mass"), None), known.pop(("load", "length"), None)
    if mass_kg is not None and length_m is not None:
        known.setdefault(("load", "gravity"), mass_kg * G_M_S2 * length_m)
        known.setdefault(("load", "inertia"), mass_kg * length_m**2)
