"""What is done with the pneumatic muscle: let go from either side of its source, and swept slowly across it."""

from dataclasses import dataclass
from functools import cached_property, partial
from math import pi, sqrt
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from norton_bench.arrays import FloatArray
from norton_bench.gallery.claim import PaperExperiment, Shown, mean, place_rad, row, swept
from norton_bench.gallery.curve import Curve, read_torque, there_and_back
from norton_bench.gallery.dynamic_source import SwungMuscle, dynamic_source
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.waves import hold, ramp, zero_torque
from norton_bench.records import Measured, SegmentInfo
from norton_bench.report.figures_network import legend
from norton_bench.report.svg import ACCENT, MEASURED, MUTED, PREDICTED, figure
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

# Commands as shares of the greatest; both ends of a sweep, and its speed.
LEVELS = (0.5, 1.0)
REACH_RAD, SPEED_RAD_S = 0.45, 0.4
SETTLE_S, LOOK_S, LEAVE_S = 1.2, 0.3, 0.5
REFERENCES, REFERENCE_RAD = 4, 0.15


@dataclass(frozen=True)
class MuscleSweeps:
    """Under each command: the free port's place, reached from either side, and the torque along slow sweeps."""

    rounds: int = 5
    name: ClassVar[str] = "gallery muscle"

    def require(self, rig: Rig) -> None:
        require_load(rig, self.name, "to move the port")

    def duration_s(self, rig: Rig) -> float:
        each_s = 2 * (2 * REACH_RAD / SPEED_RAD_S + REACH_RAD / SPEED_RAD_S + SETTLE_S + 0.6)
        reference_s = SETTLE_S + 2 * REFERENCES * (2 * REFERENCE_RAD / SPEED_RAD_S + 0.2)
        return self.rounds * len(LEVELS) * (each_s + LEAVE_S + SETTLE_S) + reference_s

    def plan(self, known: Knowledge) -> Plan:
        rig, tick_s, before = known.rig, known.tick_s, 0.0
        for _ in range(self.rounds):
            for share in LEVELS:
                command = share * rig.command.limit
                yield zero_torque(self.name, "change", Use.PREPARE, ramp(before, command, LEAVE_S, tick_s), rig)
                held = hold(command, SETTLE_S, tick_s)
                rested = yield zero_torque(self.name, "settle", Use.PREPARE, held, rig)
                centre_rad = here_rad = place_rad(rested)
                for side, name in ((-1.0, "up"), (1.0, "down")):
                    away_rad = centre_rad + side * REACH_RAD - here_rad
                    yield swept(self.name, "away", command, away_rad, SPEED_RAD_S, tick_s)
                    across_rad = -2 * side * REACH_RAD
                    yield swept(self.name, f"sweep {name} {share:g}", command, across_rad, SPEED_RAD_S, tick_s)
                    rested = yield zero_torque(self.name, f"free {name} {share:g}", Use.PREPARE, held, rig)
                    here_rad = place_rad(rested)
                before = command
        yield zero_torque(self.name, "leave", Use.PREPARE, ramp(before, 0.0, LEAVE_S, tick_s), rig)
        yield from self._reference(known)

    def _reference(self, known: Knowledge) -> Plan:
        """Where the tare was taken, without a command: what the torque sensor reads there now has drifted since."""
        rig, tick_s = known.rig, known.tick_s
        rested = yield zero_torque(self.name, "settle", Use.PREPARE, hold(0.0, SETTLE_S, tick_s), rig)
        away_rad = -REFERENCE_RAD - place_rad(rested)
        yield swept(self.name, "away", 0.0, away_rad, SPEED_RAD_S, tick_s)
        for _ in range(REFERENCES):
            for name, across_rad in (("up", 2 * REFERENCE_RAD), ("down", -2 * REFERENCE_RAD)):
                yield swept(self.name, f"reference {name} 0", 0.0, across_rad, SPEED_RAD_S, tick_s)
        yield zero_torque(self.name, "leave", Use.PREPARE, hold(0.0, LEAVE_S, tick_s), rig)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known


DISPLACED_RAD = 0.3


@dataclass(frozen=True)
class Sweep:
    """One sweep there and back under one command."""

    share: float
    command: float
    exertion: Curve


@dataclass(frozen=True)
class Muscle:
    """The true muscle, and what the bench measured of it."""

    experiment: PaperExperiment

    @property
    def spring(self) -> float:
        return self.experiment.true["spring"]

    def source_rad(self, command: float) -> float:
        """θ_N(c): the root between 0 and π of 0 = (π − θ)² c − K θ."""
        half = pi + self.spring / (2 * command)
        return half - sqrt(half * half - pi * pi)

    def exertion_nm(self, command: float, place_rad: npt.ArrayLike) -> FloatArray:
        """K (θ_N (π − θ)²/(π − θ_N)² − θ)."""
        source, place = self.source_rad(command), np.asarray(place_rad, dtype=float)
        return np.asarray(self.spring * (source * (pi - place) ** 2 / (pi - source) ** 2 - place))

    def stiffness_nm_rad(self, command: float) -> float:
        """What the exertion falls by with the place, at the source."""
        source = self.source_rad(command)
        return self.spring * (2 * source / (pi - source) + 1)

    @cached_property
    def shares(self) -> tuple[float, ...]:
        return tuple(dict.fromkeys(sweep.share for sweep in self.sweeps))

    @cached_property
    def sweeps(self) -> tuple[Sweep, ...]:
        return self._sweeps("sweep", self.drift_nm_s)

    @cached_property
    def drift_nm_s(self) -> float:
        """By how much the torque sensor's zero wanders: the place of the tare, visited again without a command."""
        again = self._sweeps("reference", 0.0)
        tare, last = self.experiment.measured.segments[0], self._swept("reference")[-1]
        drifted_nm = float(np.mean([sweep.exertion.at(self._tare_rad) for sweep in again]))
        return drifted_nm / ((last.start_ns - tare.start_ns) * 1e-9)

    @cached_property
    def _tare_rad(self) -> float:
        tare = self.experiment.measured.segments[0]
        return float(np.mean(self.experiment.measured.between(tare.start_ns, tare.end_ns).motion["position_rad"]))

    def _sweeps(self, name: str, drift_nm_s: float) -> tuple[Sweep, ...]:
        ups, downs = (self._swept(f"{name} {way}") for way in ("up", "down"))
        return tuple(self._sweep(up, down, drift_nm_s) for up, down in zip(ups, downs, strict=True))

    def of(self, share: float) -> tuple[Sweep, ...]:
        return tuple(sweep for sweep in self.sweeps if sweep.share == share)

    def free_rad(self, share: float) -> FloatArray:
        """Where the free port rested, the mean of both sides: one a round."""
        sides = [
            [_end_rad(self.experiment.measured, each) for each in self._swept(f"free {name}") if _share(each) == share]
            for name in ("up", "down")
        ]
        return np.asarray(np.mean(sides, axis=0))

    def _swept(self, name: str) -> list[SegmentInfo]:
        segments = self.experiment.measured.segments
        return [each for each in segments if each.procedure == MuscleSweeps.name and each.name.startswith(name)]

    def _sweep(self, up: SegmentInfo, down: SegmentInfo, drift_nm_s: float) -> Sweep:
        curve = there_and_back(*(self._way(segment, drift_nm_s) for segment in (up, down)))
        inside = self.experiment.measured.between(up.start_ns, up.end_ns)
        return Sweep(_share(up), float(np.mean(inside.ticks["command"])), curve)

    def _way(self, segment: SegmentInfo, drift_nm_s: float) -> tuple[FloatArray, FloatArray]:
        """Positions, increasing, and torque less the sensor's zero."""
        position_rad, torque_nm = read_torque(self.experiment.measured, segment)
        since_s = (segment.start_ns - self.experiment.measured.segments[0].start_ns) * 1e-9
        return position_rad, torque_nm - self.experiment.torque_zero_nm - drift_nm_s * since_s


def claims(experiment: PaperExperiment) -> tuple[Shown, ...]:
    """All of them. Raises ExperimentError where the recording lacks what they need."""
    return nonlinear_connection(Muscle(experiment)), dynamic_source(SwungMuscle(experiment))


def nonlinear_connection(muscle: Muscle) -> Shown:
    name, rows = "nonlinear connection", []
    for share in muscle.shares:
        sweeps = muscle.of(share)
        command = float(np.mean([sweep.command for sweep in sweeps]))
        source = muscle.source_rad(command)
        other = muscle.source_rad(
            command * (muscle.shares[0] if share == muscle.shares[1] else muscle.shares[1]) / share
        )
        free = mean(muscle.free_rad(share))
        zero = mean([sweep.exertion.zero_rad(free.value) for sweep in sweeps])
        rows += [
            row(name, f"free port's place, c = {command:.3g}", "rad", source, free, other),
            row(name, "place without exertion", "rad", source, zero, other),
        ]
        for displaced in (-DISPLACED_RAD, DISPLACED_RAD):
            place = free.value + displaced
            result = mean([sweep.exertion.at(place) for sweep in sweeps])
            linear = -muscle.stiffness_nm_rad(command) * (place - source)
            expected = float(muscle.exertion_nm(command, place))
            rows.append(row(name, f"exertion {displaced:+g} rad from there", "N*m", expected, result, linear))
    return Shown(
        name,
        "A muscle's connection is nonlinear, and zero at its source",
        "IV.C.2",
        "Its exertion is no function of the displacement from the source alone, and yet it vanishes at the source.",
        tuple(rows),
        partial(draw_nonlinear_connection, muscle, REACH_RAD),
        "Exertion along slow sweeps (mean of both directions) under two commands, closed form, and the straight line "
        "that a linear connection would have. Crosses: where the free port rested.",
    )


def _share(segment: SegmentInfo) -> float:
    return float(segment.name.split()[-1])


def _end_rad(measured: Measured, segment: SegmentInfo) -> float:
    end = measured.between(segment.end_ns - round(LOOK_S * 1e9), segment.end_ns)
    return float(np.mean(end.motion["position_rad"]))


def draw_nonlinear_connection(muscle: "Muscle", reach_rad: float) -> Figure:
    picture = figure(3.6)
    axes = picture.subplots()
    for place, share in enumerate(muscle.shares):
        sweep, first = muscle.of(share)[0], place == 0
        source = muscle.source_rad(sweep.command)
        reach = source + np.linspace(-reach_rad, reach_rad, 61)
        linear = -muscle.stiffness_nm_rad(sweep.command) * (reach - source)
        axes.plot(reach, linear, color=MUTED, linestyle=(0, (4, 3)), label="a linear connection" if first else None)
        axes.plot(
            sweep.exertion.position_rad[::12], sweep.exertion.torque_nm[::12], color=MEASURED, linestyle="none",
            marker="o", markersize=3.5, label="measured" if first else None,
        )  # fmt: skip
        label = "K (θ_N (π − θ)²/(π − θ_N)² − θ)" if first else None
        axes.plot(reach, muscle.exertion_nm(sweep.command, reach), color=PREDICTED, label=label)
        free = muscle.free_rad(share)
        label = "the free port's place" if first else None
        axes.plot(free, 0.0 * free, linestyle="none", marker="x", markersize=7, color=ACCENT, label=label, zorder=4)
        axes.annotate(f"c = {sweep.command:.3g} N·m/rad", (reach[-1], linear[-1]), color=MUTED, ha="right", va="top")
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.set_xlabel("place of the port θ [rad]")
    axes.set_ylabel("exertion [N·m]")
    legend(axes)
    return picture
