"""The claim about the impedances on either side of a load that hangs on the shaft (IV.C): Z_P = Z_A − Z_G."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from math import asin, sin, sqrt
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure

from norton_bench.arrays import FloatArray
from norton_bench.control.calibration import LoadCalibration
from norton_bench.distributions import normal_quantile
from norton_bench.gallery.claim import LEVEL, PaperExperiment, Row, Shown, mean, place_rad, row, swept, wider
from norton_bench.gallery.curve import Curve, read_torque, sent_torque, there_and_back
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.waves import hold, pushed, ramp, zero_torque
from norton_bench.records import Measured, SegmentInfo
from norton_bench.report.figures_network import legend
from norton_bench.report.svg import ACCENT, MEASURED, MUTED, PREDICTED, figure
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use

SHARE = 0.6  # of the greatest command
SIGNS = (1.0, -1.0)
SETTLE_S, LEAVE_S = 1.0, 1.0
# The imposed sweep, about where the actuator's port is free: below it, above it, and how fast.
BELOW_RAD, ABOVE_RAD, SPEED_RAD_S = 0.4, 0.1, 0.4
# How far the load pushes to either side at the external port, and how long each of its ways takes.
PUSH_NM, PUSH_S = 0.06, 3.0
CARRY_S = 4.0
SWEPT, PUSHED, CARRIED = "swept", "pushed", "carried"
# Rows are about the external port's source, and about positions beside it.
BESIDE_RAD = 0.08


@dataclass(frozen=True)
class PortImpedances:
    """Three slow ways there and back, and their mirror images.

    *Swept* as imposed motion under one command, the sensor reads Z_A. *Carried* by the actuator alone while its command
    goes slowly up and down, the load's arm asks Z_G of it. *Pushed* by the load under the first command, the external
    port answers with Z_P.
    """

    rounds: int = 4
    name: ClassVar[str] = "gallery impedances"

    def require(self, rig: Rig) -> None:
        require_load(rig, self.name, "on which the second arm hangs")

    def duration_s(self, rig: Rig) -> float:
        swept_s = 2 * LEAVE_S + SETTLE_S + 3 * ((BELOW_RAD + ABOVE_RAD) / SPEED_RAD_S + 0.2)
        return self.rounds * len(SIGNS) * (swept_s + 4 * PUSH_S + 2 * CARRY_S)

    def plan(self, known: Knowledge) -> Plan:
        for _ in range(self.rounds):
            for sign in SIGNS:
                yield from self._swept(known.rig, sign)
                yield from self._pushed(known.rig, sign)
                yield from self._carried(known.rig, sign)

    def _swept(self, rig: Rig, sign: float) -> Plan:
        tick_s, command = rig.tick_s, sign * SHARE * rig.command.limit
        there = np.append(ramp(0.0, command, LEAVE_S, tick_s), hold(command, SETTLE_S, tick_s))
        rested = yield zero_torque(self.name, "settle", Use.PREPARE, there, rig)
        lowest_rad, across_rad = place_rad(rested) - sign * BELOW_RAD, sign * (BELOW_RAD + ABOVE_RAD)
        yield swept(self.name, "away", command, lowest_rad - place_rad(rested), SPEED_RAD_S, tick_s)
        for way, distance_rad in (("there", across_rad), ("back", -across_rad)):
            yield swept(self.name, f"{SWEPT} {way} {sign:+.0f}", command, distance_rad, SPEED_RAD_S, tick_s)

    def _pushed(self, rig: Rig, sign: float) -> Plan:
        tick_s, command = rig.tick_s, sign * SHARE * rig.command.limit
        ways = (
            ("to", 0.0, -1.0),
            (f"{PUSHED} there {sign:+.0f}", -1.0, 1.0),
            (f"{PUSHED} back {sign:+.0f}", 1.0, -1.0),
        )
        for name, start, stop in (*ways, ("from", -1.0, 0.0)):
            torque_nm = sign * PUSH_NM * _steady(start, stop, PUSH_S, tick_s)
            yield pushed(self.name, name, Use.PREPARE, torque_nm, np.full(len(torque_nm), command))

    def _carried(self, rig: Rig, sign: float) -> Plan:
        tick_s, greatest = rig.tick_s, sign * rig.command.limit
        yield self._with_command("down", ramp(SHARE * greatest, 0.0, LEAVE_S, tick_s))
        yield self._with_command(f"{CARRIED} there {sign:+.0f}", _steady(0.0, greatest, CARRY_S, tick_s))
        yield self._with_command(f"{CARRIED} back {sign:+.0f}", _steady(greatest, 0.0, CARRY_S, tick_s))

    def _with_command(self, name: str, command: FloatArray) -> Segment:
        return pushed(self.name, name, Use.PREPARE, np.zeros(len(command)), command)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known


def _steady(start: float, stop: float, duration_s: float, tick_s: float) -> FloatArray:
    """At one rate all the way: then speeds are the same there and back, and what damping adds cancels."""
    return np.linspace(start, stop, round(duration_s / tick_s))


Reading = Callable[[Measured, SegmentInfo], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Impedances:
    """The true arms, and the curves that the bench measured: one a round."""

    experiment: PaperExperiment

    @cached_property
    def torque_nm(self) -> float:
        """What the command gives the motor."""
        return self.experiment.true["torque_gain"] * SHARE * self.experiment.rig.command.limit

    def source_rad(self, carried_nm: float) -> float:
        """Where the command carries arms of this greatest torque."""
        return asin(self.torque_nm / carried_nm)

    @property
    def own_nm(self) -> float:
        return self.experiment.true["gravity"]

    @property
    def load_nm(self) -> float:
        return self.experiment.true["load_gravity"]

    @property
    def bench(self) -> LoadCalibration:
        """The bench's own calibration of its load drive."""
        assert self.experiment.load is not None  # every experiment begins with one
        return self.experiment.load

    @property
    def gain_deviation(self) -> float:
        """Of the load drive's torque gain, relative."""
        place = self.bench.covariance_names.index("torque_gain")
        return sqrt(self.bench.covariance[place][place]) / self.bench.torque_gain

    @cached_property
    def actuator(self) -> tuple[Curve, ...]:
        """Z_A, as it is at the actuator's port under the command."""
        return self._curves(SWEPT, read_torque)

    @cached_property
    def load(self) -> tuple[Curve, ...]:
        """Z_G, what the load's arm asks of the actuator."""
        return self._curves(CARRIED, read_torque)

    @cached_property
    def port(self) -> tuple[Curve, ...]:
        """Z_P as the external port answers when it is pushed."""
        sent = self._curves(PUSHED, sent_torque)
        return tuple(Curve(each.position_rad, -self.bench.torque_gain * each.torque_nm) for each in sent)

    @cached_property
    def composed(self) -> tuple[Curve, ...]:
        """Z_P as it is composed of the two."""
        return tuple(own.minus(other) for own, other in zip(self.actuator, self.load, strict=True))

    def _curves(self, name: str, reading: Reading) -> tuple[Curve, ...]:
        measured = self.experiment.measured
        ways = [
            [
                reading(measured, each)
                for each in self.experiment.segments(PortImpedances.name, f"{name} {way} {sign:+.0f}")
            ]
            for sign in SIGNS
            for way in ("there", "back")
        ]
        return tuple(there_and_back(*one[:2]).mirrored(there_and_back(*one[2:])) for one in zip(*ways, strict=True))


def port_impedances(found: Impedances) -> Shown:
    name, source = "port impedances", found.source_rad(found.own_nm + found.load_nm)
    carried = mean([each.at(source) for each in found.load])
    rows = [row(name, "Z_G at θ_N", "N*m", found.load_nm * sin(source), carried, 0.0)]
    gain_off = normal_quantile(0.5 + 0.5 * LEVEL) * found.gain_deviation
    rows += _rows_of("Z_A − Z_G", found.composed, found)
    rows += _rows_of("Z_P, pushed", found.port, found, gain_off)
    return Shown(
        name,
        "The impedance at one port follows from that at another and what lies between",
        "IV.C",
        "Z_P(θ_N, θ) = Z_A(θ̂_N − θ) − Z_G(θ), zero at the external port's own source.",
        tuple(rows),
        partial(draw, found),
        "Torque against position under one command (means of both directions, half differences of either sign): at the "
        "actuator's port, what the load's arm asks, their difference, and what the external port answers when pushed.",
    )


def _rows_of(how: str, curves: Sequence[Curve], found: Impedances, gain_off: float = 0.0) -> Iterator[Row]:
    """Beside the source and at it; ``gain_off`` is a relative tolerance for what no repetition shows."""
    name, both_nm = "port impedances", found.own_nm + found.load_nm
    source = found.source_rad(both_nm)
    for beside in (-BESIDE_RAD, BESIDE_RAD):
        place = source + beside
        expected, alone = (found.torque_nm - carried_nm * sin(place) for carried_nm in (both_nm, found.own_nm))
        value = wider(mean([each.at(place) for each in curves]), gain_off * abs(expected))
        yield row(name, f"{how} at θ_N {beside:+g} rad", "N*m", expected, value, alone)
    # A position is not read more finely than a count.
    zero = wider(mean([each.zero_rad(source) for each in curves]), found.bench.position_resolution_rad)
    yield row(name, f"zero of {how}", "rad", source, zero, found.source_rad(found.own_nm))


def draw(found: Impedances) -> Figure:
    picture = figure(3.6)
    axes = picture.subplots()
    own, load, both = found.actuator[0], found.load[0], found.port[0]
    place = np.linspace(both.position_rad[0], both.position_rad[-1], 61)
    closed = (
        (found.torque_nm - found.own_nm * np.sin(place), (0, (4, 3)), "closed forms"),
        (found.load_nm * np.sin(place), (0, (4, 3)), None),
        (found.torque_nm - (found.own_nm + found.load_nm) * np.sin(place), "-", None),
    )
    for torque_nm, style, label in closed:
        axes.plot(place, torque_nm, color=PREDICTED, linestyle=style, label=label)
    for curve, marker, color, label in (
        (own, "^", MEASURED, "Z_A, at the actuator's port"),
        (load, "v", MEASURED, "Z_G, of the load's arm"),
        (found.composed[0], "o", MEASURED, "Z_A − Z_G"),
        (both, "x", ACCENT, "Z_P, pushed at the external port"),
    ):
        shown = np.flatnonzero((curve.position_rad >= place[0]) & (curve.position_rad <= place[-1]))[::20]
        axes.plot(
            curve.position_rad[shown], curve.torque_nm[shown], linestyle="none", marker=marker, markersize=4.5,
            color=color, label=label, markerfacecolor="none" if marker != "x" else color,
        )  # fmt: skip
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.set_xlabel("position of the shaft θ [rad]")
    axes.set_ylabel("torque [N·m]")
    legend(axes)
    return picture
