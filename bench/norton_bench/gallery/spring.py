"""The claim of sections IV.B and VI about a second input: π sets the impedance and leaves the source alone."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from norton_bench.errors import ExperimentError
from norton_bench.gallery.claim import PaperExperiment, Shown, mean, row, wider
from norton_bench.identification.exertion_table import ExertionTable, exertion_table
from norton_bench.procedures.modulated import WAY, ModulatedProcedure
from norton_bench.procedures.options import TabulateImpedanceOptions
from norton_bench.procedures.tabulate_impedance import TabulateImpedanceProcedure
from norton_bench.report.figures_network import legend
from norton_bench.report.svg import MEASURED, MUTED, PREDICTED, figure

MODULATIONS = (0.0, 2.0, 4.0)  # in the rig's unit, N m/rad
ROUNDS = 5
# Under one command: to the source, then held on either side of it, in both directions.
TABULATION = TabulateImpedanceProcedure(
    TabulateImpedanceOptions(commands=1, lowest=0.5, highest=0.5, steps=2, hold_s=0.3, shake_rad=0.0, sweep_rad_s=0.0)
)
EXPERIMENT = ModulatedProcedure(TABULATION, ROUNDS * MODULATIONS)


@dataclass(frozen=True)
class VariableSpring:
    """The true actuator, and what the bench tabulated of it: a table for each visit to a modulation."""

    experiment: PaperExperiment

    @cached_property
    def visits(self) -> tuple[ExertionTable, ...]:
        measured = self.experiment.measured
        ways = [each for each in measured.segments if each.procedure == EXPERIMENT.name and each.name == WAY]
        if len(ways) != len(EXPERIMENT.modulations) + 1:
            raise ExperimentError("the modulations were not all recorded; run it again")
        parts = [measured.between(before.end_ns, after.start_ns) for before, after in pairwise(ways)]
        return tuple(exertion_table(part, self.experiment.rig.tick_s) for part in parts)

    def of(self, modulation: float) -> tuple[ExertionTable, ...]:
        return tuple(visit for visit in self.visits if visit.modulations == (modulation,))

    @property
    def command(self) -> float:
        return self.visits[0].settings[0].command

    def stiffness_nm_rad(self, modulation: float) -> float:
        """The spring's, k0 + k1 p, in series with the motor's position loop."""
        true = self.experiment.true
        spring = true["spring_stiffness"] + true["spring_stiffening"] * true["modulator_travel"] * modulation
        return 1 / (1 / spring + 1 / true["servo_stiffness"])

    def left_open_nm_rad(self, modulation: float) -> float:
        """What the motor's friction leaves open of it: its position loop may stop short of either end, by τc over k."""
        reach_rad = min(np.ptp([held.displacement_rad for held in visit.held]) for visit in self.of(modulation))
        short_rad = self.experiment.true["motor_coulomb_torque"] / self.experiment.true["servo_stiffness"]
        return self.stiffness_nm_rad(modulation) * 2 * short_rad / float(reach_rad)


def claims(experiment: PaperExperiment) -> tuple[Shown, ...]:
    """All of them. Raises ExperimentError where the recording lacks what they need."""
    return (one_source_many_springs(VariableSpring(experiment)),)


def one_source_many_springs(spring: VariableSpring) -> Shown:
    name, least, most = "variable stiffness", MODULATIONS[0], MODULATIONS[-1]
    rows = []
    for modulation in MODULATIONS:
        result = mean([visit.lines()[0].stiffness.value for visit in spring.of(modulation)])
        result = wider(result, spring.left_open_nm_rad(modulation))
        rival = spring.stiffness_nm_rad(least if modulation != least else most)
        expected = spring.stiffness_nm_rad(modulation)
        rows.append(row(name, f"stiffness at the source, π = {modulation:g}", "N*m/rad", expected, result, rival))
    ends = [[visit.lines()[0].source.value for visit in spring.of(modulation)] for modulation in (least, most)]
    # A source of exertion pulls with the same torque, whatever the spring: the place goes with its compliance.
    rival = spring.command * (spring.stiffness_nm_rad(least) / spring.stiffness_nm_rad(most) - 1)
    shift = mean(np.subtract(ends[1], ends[0]))
    rows.append(row(name, f"the source moves, π = {least:g} to {most:g}", "rad", 0.0, shift, rival))
    return Shown(
        name,
        "A second input sets the impedance and leaves the source alone",
        "IV.B, VI",
        "ż = Z_state(z, Δx, π), f = Z_output(z, Δx, π): π acts on the connection, and the source does not know of it.",
        tuple(rows),
        partial(draw_one_source_many_springs, spring, MODULATIONS),
        "Torque of the port held beside its source, under one command and three modulations, in the first round; lines "
        "are the closed forms, which all cross zero at the source.",
    )


def draw_one_source_many_springs(spring: "VariableSpring", modulations: Sequence[float]) -> Figure:
    picture = figure(3.6)
    axes = picture.subplots()
    for place, modulation in enumerate(modulations):
        table = spring.of(modulation)[0]
        away, torque_nm, _ = table.curve(table.settings[0])
        reach = np.array([away[0], away[-1]])
        closed = -spring.stiffness_nm_rad(modulation) * reach
        axes.plot(reach, closed, color=PREDICTED, label="closed form" if place == 0 else None)
        label = "measured, mean of both directions" if place == 0 else None
        axes.plot(away, torque_nm, linestyle="none", marker="o", markersize=4, color=MEASURED, label=label)
        axes.annotate(f"π = {modulation:g} N·m/rad", (reach[0], closed[0]), color=MUTED, va="bottom")
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.axvline(0.0, color=MUTED, linewidth=0.6)
    axes.margins(y=0.12)  # room for the highest label
    axes.set_xlabel("displacement from the source, θ − θ_N [rad]")
    axes.set_ylabel("exertion [N·m]")
    legend(axes)
    return picture
