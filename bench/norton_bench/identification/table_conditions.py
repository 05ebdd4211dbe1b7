"""The paper's three conditions (IV.B, VI) where no model was fitted: asked of the tables of source and exertion."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.averages import Mean, Setting
from norton_bench.identification.conditions import Condition, Interval, share_left, usable
from norton_bench.identification.exertion_table import ExertionTable, Zeros
from norton_bench.identification.source_table import SourceTable


# One actuator seen at two ports: θ̂_N = θ_N + Z_A⁻¹(Z_G(θ_N)), from tables alone (paper, section IV.C).
@dataclass(frozen=True)
class PortsRow:
    """One setting. ``external`` and ``actuator`` are the sources θ_N and θ̂_N at the two ports [rad].

    ``load`` is what the load's body asked of the actuator at θ_N, read there [N m]: Z_G(θ_N). ``exertion`` is what
    the actuator's own table says that it exerts so far from θ̂_N, and it should be the same; NaN where the table
    does not reach.
    """

    setting: Setting
    external: Mean
    actuator: Mean
    load: Mean
    exertion: Mean

    @property
    def apart_rad(self) -> float:
        """θ̂_N − θ_N."""
        return self.actuator.value - self.external.value


def two_ports(source: SourceTable | None, exertion: ExertionTable | None) -> tuple[PortsRow, ...]:
    """Every setting that was tabulated at both ports; none without both."""
    if source is None or not {"actuator", "external"} <= set(source.ports):
        return ()
    return tuple(_rows(source, exertion))


def _rows(source: SourceTable, exertion: ExertionTable | None) -> Iterator[PortsRow]:
    actuator = {row.setting.rounded: row for row in source.rows("actuator")}
    for row in source.rows("external"):
        other = actuator.get(row.setting.rounded)
        if other is not None:
            away_rad = row.position.value - other.position.value
            yield PortsRow(
                row.setting, row.position, other.position, row.torque, _exerted(exertion, row.setting, away_rad)
            )


def _exerted(exertion: ExertionTable | None, setting: Setting, displacement_rad: float) -> Mean:
    """What the table says, and as much either way as friction leaves open there."""
    if exertion is None or setting.rounded not in exertion.sources:
        return Mean(float("nan"), float("nan"))
    _, _, half_nm = exertion.curve(setting)
    return Mean(exertion.exertion_nm(setting, displacement_rad), float(max(half_nm)) + exertion.hysteresis_nm(setting))


# Pieces of a sweep that are drawn together, for an interval.
BLOCK = 5


# The paper's three conditions (IV.B, VI) where no model was fitted: asked of the tables of source and exertion.
def tabulated_conditions(source: SourceTable | None, exertion: ExertionTable | None) -> tuple[Condition, ...]:
    """The three of them, in the paper's order; none where nothing was tabulated."""
    if source is None and exertion is None:
        return ()
    return (_impedance_form(exertion), _unique_zero(exertion), _zero_dynamics(source))


def _impedance_form(exertion: ExertionTable | None) -> Condition:
    """The port swept slowly should exert what it exerted where it was held, come to from the same side."""
    name, figure = "impedance form", "share of the torque along slow sweeps that the places held do not tell"
    error_nm, torque_nm = (np.empty(0), np.empty(0)) if exertion is None else _swept_and_held(exertion)
    if torque_nm.size < 2 * BLOCK:
        why = "the port was held still at each place and not swept: whether a moving one tells its torque was not tried"
        return Condition(name, None, why)
    share, interval = share_left(error_nm, torque_nm, BLOCK)
    holds = usable(interval)
    why = {
        True: "swept slowly, the port exerts what it exerted at the places where it was held",
        False: "swept slowly, the port exerts something else than at the places where it was held",
        None: "swept slowly, the port exerts in part what it exerted where it was held: take more steps",
    }[holds]
    return Condition(name, holds, why, figure, share, interval)


def _swept_and_held(exertion: ExertionTable) -> tuple[FloatArray, FloatArray]:
    """What the places held leave of the torque along every sweep, and that torque: (pieces,) each."""
    errors, torques = [], []
    for sweep in exertion.swept:
        place, torque_nm, _ = sweep.branch
        held_at, held_nm, _ = exertion.branch(sweep.setting, sweep.rising)
        if held_at.size > 1:
            known = (place >= held_at[0]) & (place <= held_at[-1])
            torques.append(torque_nm[known])
            errors.append(torque_nm[known] - np.interp(place[known], held_at, held_nm))
    return np.concatenate([np.empty(0), *errors]), np.concatenate([np.empty(0), *torques])


def _unique_zero(exertion: ExertionTable | None) -> Condition:
    """One place without torque under each setting; of several the one whose range of zeros may be the widest."""
    name, figure = "unique zero", "width of the interval of zeros"
    result = [] if exertion is None else [line.zeros for line in exertion.lines() if line.zeros is not None]
    if exertion is None or not result:
        return Condition(name, None, "the port was not held on both sides of its source: run 'tabulate_impedance'")
    zeros = max([each for each in result if each.is_gap] or result, key=lambda each: each.width.value)
    several = any(_crossings(exertion, setting) > 1 for setting in exertion.settings)
    holds, why = (False, "under one command the torque vanishes at several places") if several else _one_place(zeros)
    return Condition(name, holds, why, figure, zeros.width.value, _ends(zeros), "rad")


def _one_place(zeros: Zeros) -> tuple[bool | None, str]:
    if zeros.is_gap:
        return False, (
            f"backlash: between {_mrad(zeros.low_rad)} and {_mrad(zeros.high_rad)} from its place of rest the port "
            "exerts nothing, so its source is known to within that"
        )
    if _ends(zeros)[1] > zeros.spacing_rad:
        return None, "whether the port exerts nothing over a range is lost in friction, or between the places"
    return True, (
        "under each command the torque, friction aside, vanishes at one place; a range without torque narrower than "
        f"{_mrad(zeros.spacing_rad)}, as far as places lie apart, would not show"
    )


def _ends(zeros: Zeros) -> Interval:
    half_rad = zeros.width.half_width
    return max(zeros.width.value - half_rad, 0.0), zeros.width.value + half_rad


def _mrad(angle_rad: float) -> str:
    return f"{1e3 * angle_rad:.3g} mrad"


def _crossings(exertion: ExertionTable, setting: Setting) -> int:
    """How often the torque changes its sign, by more than friction leaves open, from one end to the other."""
    _, torque_nm, half_nm = exertion.curve(setting)
    clear_nm = half_nm + np.nan_to_num(exertion.hysteresis_nm(setting))
    signs = np.sign(torque_nm[np.abs(torque_nm) > clear_nm])
    return int(np.count_nonzero(np.diff(signs)))


def _zero_dynamics(source: SourceTable | None) -> Condition:
    """Whether the free port came to rest, at its own port, under each command."""
    name, figure = "stable zero dynamics", "the longest that the free port took to settle"
    levels = () if source is None else [level for level in source.levels if level.port == "actuator"]
    if not levels:
        return Condition(name, None, "the free port was not let settle under several commands: run 'tabulate_source'")
    moving = sum(not level.settled for level in levels)
    longest_s = float(np.max([level.settling_s for level in levels]))
    if not moving:
        holds, why = True, f"with no torque at the port, it came to rest at all {len(levels)} levels of the command"
    elif moving == len(levels):
        holds, why = False, "with no torque at the port, it came to rest at no level of the command"
    else:
        holds, why = None, f"at {moving} of {len(levels)} levels of the command the port still moved: wait longer"
    return Condition(name, holds, why, figure, longest_s, unit="s")
