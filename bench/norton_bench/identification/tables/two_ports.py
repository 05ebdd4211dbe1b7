"""One actuator seen at two ports: θ̂_N = θ_N + Z_A⁻¹(Z_G(θ_N)), from tables alone (paper, section IV.C)."""

from collections.abc import Iterator
from dataclasses import dataclass

from norton_bench.identification.tables.exertion_table import ExertionTable
from norton_bench.identification.tables.means import Mean, Setting
from norton_bench.identification.tables.source_table import SourceTable


@dataclass(frozen=True)
class PortsRow:
    """One setting. ``external`` and ``actuator`` are the sources θ_N and θ̂_N at the two ports [rad].

    ``load`` is what the load's body asked of the actuator at θ_N, read there [N m]: Z_G(θ_N). ``exertion`` is what the
    actuator's own table says that it exerts so far from θ̂_N, and it should be the same; NaN where the table does not
    reach.
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
