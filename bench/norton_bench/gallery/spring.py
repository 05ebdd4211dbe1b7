"""The claims about a spring behind a place that a drive holds: a second input sets the impedance and leaves the source
alone (IV.B, VI), and without the source's motion the impedance cannot be told (VI.E)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.gallery.claim import PaperExperiment, Shown, mean, row, wider
from norton_bench.identification.exertion_table import ExertionTable, exertion_table
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.modulated import WAY, ModulatedProcedure
from norton_bench.procedures.options import TabulateImpedanceOptions
from norton_bench.procedures.tabulate_impedance import TabulateImpedanceProcedure
from norton_bench.procedures.waves import from_velocity, hold, imposed, ramp, zero_torque
from norton_bench.records import Measured, SegmentInfo, Table
from norton_bench.report.figures_network import legend
from norton_bench.report.svg import MEASURED, MUTED, PREDICTED, figure
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

MODULATIONS = (0.0, 2.0, 4.0)  # in the rig's unit, N m/rad
ROUNDS = 5
# Under one command: to the source, then held on either side of it, in both directions.
TABULATION = TabulateImpedanceProcedure(
    TabulateImpedanceOptions(commands=1, lowest=0.5, highest=0.5, steps=2, hold_s=0.3, shake_rad=0.0, sweep_rad_s=0.0)
)
EXPERIMENT = ModulatedProcedure(TABULATION, ROUNDS * MODULATIONS)

# The source swings by so much about so many radians, and the port by these multiples of it: behind it, and ahead of it.
SWING_RAD, ABOUT_RAD, SWING_S = 0.1, 0.15, 2.0
SWING_RAD_S = 2 * np.pi / SWING_S
PORT_SHARES = (0.5, 2.0)
LEAD_S = 0.4
ALONE, WAY_THERE = "source", "way"


@dataclass(frozen=True)
class MovingSource:
    """The source moves, and the port with it: free of torque, then by less, and by more, under the same command."""

    rounds: int = 4
    name: ClassVar[str] = "gallery moving source"

    def require(self, rig: Rig) -> None:
        require_load(rig, self.name, "to move the port")

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known

    def duration_s(self, rig: Rig) -> float:
        return self.rounds * 2 * len(PORT_SHARES) * (LEAD_S + SWING_S) + 2 * LEAD_S

    def plan(self, known: Knowledge) -> Plan:
        tick_s = known.tick_s
        phase = 2 * np.pi * np.arange(1, round(SWING_S / tick_s) + 1) * tick_s / SWING_S
        lead = hold(0.0, LEAD_S, tick_s)
        # Up and down again from its lowest place, at rest at both ends.
        swing = np.concatenate([lead, 0.5 * SWING_RAD * (1.0 - np.cos(phase))])
        velocity = np.concatenate([lead, np.pi * SWING_RAD / SWING_S * np.sin(phase)])
        command = ABOUT_RAD + swing
        yield zero_torque(self.name, WAY_THERE, Use.PREPARE, ramp(0.0, ABOUT_RAD, LEAD_S, tick_s), known.rig)
        for _ in range(self.rounds):
            for share in PORT_SHARES:
                yield zero_torque(self.name, ALONE, Use.PREPARE, command, known.rig)
                motion = from_velocity(share * velocity, tick_s)
                yield imposed(self.name, f"{share:g}", Use.PREPARE, command, motion)
        yield zero_torque(self.name, WAY_THERE, Use.PREPARE, ramp(ABOUT_RAD, 0.0, LEAD_S, tick_s), known.rig)


@dataclass(frozen=True)
class Swing:
    """One imposed movement while the source moved, at the torque's readings (n,); ``source_rad`` is that of the
    movement before, free of torque but for ``left_nm``, under the same command."""

    share: float
    time_s: FloatArray
    port_rad: FloatArray
    source_rad: FloatArray
    torque_nm: FloatArray
    left_nm: FloatArray

    @property
    def stiffness_nm_rad(self) -> float:
        """Of the torque against the deviation from the source."""
        return float(np.polyfit(self.source_rad - self.port_rad, self.torque_nm - self.left_nm, 1)[0])

    @property
    def apparent_nm_rad(self) -> float:
        """Of the torque against the motion of the port, as if the source stood."""
        return float(-np.polyfit(self.port_rad, self.torque_nm, 1)[0])

    def expected_nm_rad(self, stiffness: float, damping: float, inertia: float) -> float:
        """The same of what a damped spring between this source and an inertia at the port does."""
        deviation_rad = self.source_rad + self.left_nm / stiffness - self.port_rad
        rate_rad_s = np.gradient(self.source_rad - self.port_rad, self.time_s)
        torque_nm = stiffness * deviation_rad + damping * rate_rad_s
        return float(-np.polyfit(self.port_rad, torque_nm, 1)[0]) - inertia * SWING_RAD_S**2


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
        """What the motor's friction leaves open of it, over the reach of the tabulation."""
        reach_rad = min(np.ptp([held.displacement_rad for held in visit.held]) for visit in self.of(modulation))
        return self.left_open_over_nm_rad(modulation, float(reach_rad))

    def left_open_over_nm_rad(self, modulation: float, reach_rad: float) -> float:
        """The same over any reach: the position loop may stop short of either end, by τc over k."""
        short_rad = self.experiment.true["motor_coulomb_torque"] / self.experiment.true["servo_stiffness"]
        return self.stiffness_nm_rad(modulation) * 2 * short_rad / reach_rad

    @cached_property
    def swings(self) -> tuple[Swing, ...]:
        return tuple(self._swings())

    def swings_of(self, share: float) -> list[Swing]:
        """Raises ExperimentError where there are too few for an interval."""
        result = [each for each in self.swings if each.share == share]
        if len(result) < 2:
            raise ExperimentError(f'"{MovingSource.name}" has too few movements for an interval; run it again')
        return result

    def _swings(self) -> Iterator[Swing]:
        segments = [each for each in self.experiment.measured.segments if each.procedure == MovingSource.name]
        for before, segment in pairwise(segments):
            if before.name == ALONE and segment.name not in (ALONE, WAY_THERE):
                yield self._swing(before, segment)

    def _swing(self, before: SegmentInfo, segment: SegmentInfo) -> Swing:
        begins_ns = segment.start_ns + round(1e9 * LEAD_S)
        measured = self.experiment.measured
        swing, torque = measured.between(begins_ns, begins_ns + round(1e9 * SWING_S)), _valid(measured.torque)
        torque_ns, torque_nm = (_valid(swing.torque)[each] for each in ("arrival_ns", "torque_nm"))
        if len(torque_ns) < 3:
            raise ExperimentError(f'"{MovingSource.name}" was hardly recorded; run it again')
        earlier_ns = torque_ns - segment.start_ns + before.start_ns
        motion_ns, position_rad = measured.motion["arrival_ns"], measured.motion["position_rad"]
        return Swing(
            share=float(segment.name),
            time_s=(torque_ns - begins_ns) * 1e-9,
            port_rad=np.interp(torque_ns, motion_ns, position_rad),
            source_rad=np.interp(earlier_ns, motion_ns, position_rad),
            torque_nm=np.asarray(torque_nm, dtype=np.float64),
            left_nm=np.interp(earlier_ns, torque["arrival_ns"], torque["torque_nm"]),
        )


def _valid(torque: Table) -> Table:
    valid: Table = torque[torque["valid"]]
    return valid


def claims(experiment: PaperExperiment) -> tuple[Shown, ...]:
    """All of them. Raises ExperimentError where the recording lacks what they need."""
    spring = VariableSpring(experiment)
    return one_source_many_springs(spring), unknown_source(spring)


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


def unknown_source(spring: VariableSpring) -> Shown:
    name, modulation = "unknown source", MODULATIONS[0]
    true = spring.stiffness_nm_rad(modulation)
    # What turns between spring and port swings with the port.
    inertia, damping = (spring.experiment.true[each] for each in ("output_inertia", "spring_damping"))
    rows = []
    for share in PORT_SHARES:
        swings = spring.swings_of(share)
        apparent = mean([each.apparent_nm_rad for each in swings])
        apparent = wider(apparent, spring.left_open_over_nm_rad(modulation, share * SWING_RAD))
        expected = float(np.mean([each.expected_nm_rad(true, damping, inertia) for each in swings]))
        what = f"stiffness as if the source stood, port told {share:g} times as far"
        rows.append(row(name, what, "N*m/rad", expected, apparent, true))
        known = mean([each.stiffness_nm_rad for each in swings])
        known = wider(known, spring.left_open_over_nm_rad(modulation, abs(1.0 - share) * SWING_RAD))
        what = f"stiffness about the source's own motion, port told {share:g} times as far"
        rows.append(row(name, what, "N*m/rad", true - inertia * SWING_RAD_S**2, known, apparent.value))
    return Shown(
        name,
        "Without the source's motion, the impedance is anything",
        "VI.E",
        "A port that moves while the source does shows a torque from which any stiffness follows, a negative one too. "
        "The source, found free of torque under the same command, makes it one again.",
        tuple(rows),
        partial(draw_unknown_source, spring),
        "Torque while source and port both move. Left: against the motion of the port. Right: against its deviation "
        "from the source. Lines are the closed forms.",
    )


def draw_unknown_source(spring: "VariableSpring") -> Figure:
    picture = figure(3.3)
    panels = picture.subplots(1, 2, sharey=True)
    true = spring.stiffness_nm_rad(MODULATIONS[0])
    for marker, share in zip("ov", PORT_SHARES, strict=True):
        swing = spring.swings_of(share)[0]
        apparent = swing.expected_nm_rad(
            true, *(spring.experiment.true[each] for each in ("spring_damping", "output_inertia"))
        )
        port, deviation = swing.port_rad - swing.port_rad[0], swing.port_rad - swing.source_rad
        every = slice(None, None, max(1, port.size // 40))
        for axes, away, stiffness in zip(panels, (port, deviation), (apparent, true), strict=True):
            reach = np.array([np.min(away), np.max(away)])
            line = np.mean(swing.torque_nm) - stiffness * (reach - np.mean(away))
            axes.plot(reach, line, color=PREDICTED, label="closed form" if share == PORT_SHARES[0] else None)
            axes.plot(
                away[every], swing.torque_nm[every], linestyle="none", marker=marker, markersize=4, color=MEASURED,
                markerfacecolor="none", label=f"port told {share:g} times as far",
            )  # fmt: skip
    panels[0].set_xlabel("motion of the port [rad]")
    panels[1].set_xlabel("deviation from the source, θ − θ_N [rad]")
    panels[0].set_title("The source taken to stand")
    panels[1].set_title("The source known")
    panels[0].set_ylabel("exertion [N·m]")
    panels[1].legend(loc="upper right")
    return picture


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
