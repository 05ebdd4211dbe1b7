"""The claims of section IV.D, from the experiments with the torque motor with Dahl friction."""

from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.gallery import motor_experiments as done
from norton_bench.gallery.claim import (
    Estimated,
    Look,
    PaperExperiment,
    Shown,
    StraightLine,
    looks,
    mean,
    pairs,
    row,
    wider,
)
from norton_bench.identification.branches import REST_SHARE
from norton_bench.report.figures_network import legend
from norton_bench.report.svg import ACCENT, MEASURED, MUTED, PREDICTED, figure
from norton_bench.report.words import pretty_unit

# Of each ramp the middle is looked at, in so many parts.
MIDDLE_SHARE, MIDDLE_PARTS = 0.6, 6
# In ticks. Torque and position that arrive together were read no further apart than this; and what a command does is
# seen so much later: a tick, two wires, and the torque sensor's averaging.
APART, SEEN_LATE = 1.0, 3.0


@dataclass(frozen=True)
class Ramp:
    """The middle of one ramp, as if all of it had been done in the positive direction.

    ``deviation_rad_s`` and ``torque_nm`` are those of its parts, (MIDDLE_PARTS,); ``rate_rad_s2`` is how fast the
    source's velocity changes less the port's.
    """

    deviation_rad_s: FloatArray
    torque_nm: FloatArray
    rate_rad_s2: float


@dataclass(frozen=True)
class MotorExperiment:
    """The true motor, and what the bench measured of it, each pair as its half difference."""

    experiment: PaperExperiment

    @property
    def gain(self) -> float:
        return self.experiment.true["torque_gain"]

    @property
    def damping(self) -> float:
        return self.experiment.true["viscous_damping"]

    @property
    def coulomb(self) -> float:
        return self.experiment.true["coulomb_torque"]

    def source_rad_s(self, command: float) -> float:
        """ω_N(c), in its three branches."""
        drive = self.gain * command
        return float(np.sign(drive) * max(abs(drive) - self.coulomb, 0.0) / self.damping)

    @cached_property
    def steady(self) -> FloatArray:
        """Imposed velocity and torque, and the command: shape (pairs, 3)."""
        result = self._looks(done.SteadySpeeds.name, done.STEADY_LOOK_S)
        return np.array([_odd(one, other) for one, other in pairs(result)])

    @cached_property
    def steady_line(self) -> StraightLine:
        return StraightLine(self.steady[:, 0], self.steady[:, 1])

    @cached_property
    def free(self) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Free velocity, torque left, and command (pairs, 3), and which were approached from below (pairs,).

        The velocity is that at no torque: what the load drive left of it is made up for, with the damping measured.
        """
        result = list(pairs(self._looks(done.FreeLevels.name, done.FREE_LOOK_S)))
        table = np.array([_odd(one, other) for one, other in result])
        moving = np.abs(table[:, 0]) > np.abs(table[:, 1] / self.steady_line.slope.value)
        table[moving, 0] -= table[moving, 1] / self.steady_line.slope.value
        return table, np.array([one.label[2] == "below" for one, _ in result])

    @cached_property
    def stops(self) -> dict[bool, FloatArray]:
        """Torque at rest and what was taken back (pairs, 2), for approaches with the command (True) and against it."""
        table: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
        for one, other in pairs(self._looks(done.SlowStops.name, done.STOP_LOOK_S)):
            _, taken, sign, side = one.label
            # As under approach from positive velocity: the command's sign is that of `with`.
            torque = 0.5 * float(side) * (one.torque_nm - other.torque_nm)
            table[float(sign) == float(side)].append((torque, float(taken)))
        return {with_command: np.array(result) for with_command, result in table.items()}

    @cached_property
    def ramps(self) -> dict[str, list[tuple[Ramp, ...]]]:
        """The ramps of each movement, for those in which the port's velocity changed and the source's."""
        result: dict[str, list[tuple[Ramp, ...]]] = {done.OF_PORT: [], done.OF_SOURCE: []}
        for segment in self.experiment.measured.segments:
            if segment.procedure == done.SameDeviation.name:
                moving, side = segment.name.split()
                begins_ns = segment.start_ns + round(1e9 * done.DEVIATION_LEAD_S)
                ramps = (self._ramp(begins_ns, number, float(side)) for number in range(done.DEVIATION_RAMPS))
                result[moving].append(tuple(ramps))
        return result

    def inertia(self, moving: str) -> Estimated:
        """What remains of the torque without B (ω_N − ω), over the rate of the deviation: mean of the movements."""
        return mean([self._inertia(ramps) for ramps in self.ramps[moving]])

    def _inertia(self, ramps: tuple[Ramp, ...]) -> float:
        deviation = np.array([np.mean(each.deviation_rad_s) for each in ramps])
        torque = np.array([np.mean(each.torque_nm) for each in ramps])
        rate = np.array([each.rate_rad_s2 for each in ramps])
        remains = torque + self.steady_line.slope.value * (deviation - np.mean(deviation))
        return float(np.polyfit(rate, remains, 1)[0])

    def _ramp(self, begins_ns: int, number: int, side: float) -> Ramp:
        skipped = 0.5 * (1.0 - MIDDLE_SHARE)
        edges_s = done.DEVIATION_RAMP_S * (number + np.linspace(skipped, 1.0 - skipped, MIDDLE_PARTS + 1))
        edges_ns = begins_ns + np.round(1e9 * edges_s).astype(np.int64)
        middle = self.experiment.measured.between(int(edges_ns[0]), int(edges_ns[-1]))
        torque = middle.torque[middle.torque["valid"]]
        parts = np.searchsorted(torque["arrival_ns"], edges_ns)
        if min(len(middle.motion), len(middle.ticks)) < 2 * MIDDLE_PARTS or np.any(np.diff(parts) < 1):
            raise ExperimentError(f'a ramp of "{done.SameDeviation.name}" was hardly recorded; run it again')
        time_s = (0.5 * (edges_ns[1:] + edges_ns[:-1]) - begins_ns) * 1e-9
        position = np.polyfit((middle.motion["arrival_ns"] - begins_ns) * 1e-9, middle.motion["position_rad"], 2)
        command = np.polyfit((middle.ticks["tick_ns"] - begins_ns) * 1e-9, middle.ticks["command"], 1)
        source_rad_s = np.array([self.source_rad_s(each) for each in np.polyval(command, time_s)])
        deviation_rad_s = side * (source_rad_s - np.polyval(np.polyder(position), time_s))
        rate_rad_s2 = side * (self.gain * command[0] / self.damping - 2.0 * position[0])
        means = [np.mean(torque["torque_nm"][first:last]) for first, last in pairwise(parts)]
        zero_nm = self.experiment.torque_zero_nm
        return Ramp(deviation_rad_s, side * (np.array(means) - zero_nm), float(rate_rad_s2))

    @cached_property
    def stop_command(self) -> float:
        result = self._looks(done.SlowStops.name, done.STOP_LOOK_S)
        return float(np.mean([abs(each.command) for each in result]))

    def stopped(self, with_command: bool) -> StraightLine:
        """Torque at rest against what was taken back; at none of it stands the paper's."""
        table = self.stops[with_command]
        return StraightLine(table[:, 1], table[:, 0])

    def _looks(self, procedure: str, look_s: float) -> list[Look]:
        names = ("rest", "release", "creep")
        return [each for each in looks(self.experiment.measured, procedure, look_s) if each.label[0] not in names]


def claims(experiment: PaperExperiment) -> tuple[Shown, ...]:
    """All of them. Raises ExperimentError where the recording lacks what they need."""
    motor = MotorExperiment(experiment)
    return (
        thevenin_and_norton(motor),
        three_branches(motor),
        steady_torque(motor),
        inertial_frame(motor),
        slow_approach(motor),
    )


def thevenin_and_norton(motor: MotorExperiment) -> Shown:
    name, command = "one source", motor.stop_command
    above, below = motor.stops[True], motor.stops[False]
    # Mirrored, an approach against the command is one from below under a positive command.
    apart = StraightLine(above[:, 1], -below[:, 0] - above[:, 0]).value(0.0)
    free, from_below = motor.free
    levels = np.unique(np.round(free[:, 2] / free[:, 2].max(), 3))
    same = [np.isclose(free[:, 2] / free[:, 2].max(), level, atol=0.01) for level in levels[1:]]
    differences = np.concatenate([free[at & from_below, 0] - free[at & ~from_below, 0] for at in same])
    blocked = "blocked torque, from below less from above"
    moving = "free velocity, from below less from above"
    rows = (
        row(name, blocked, "N*m", 2 * motor.coulomb, apart, 0.0),
        row(name, moving, "rad/s", 0.0, mean(differences), 2 * motor.coulomb / motor.damping),
    )
    return Shown(
        name,
        "Thévenin's source is ambiguous by ± τc, Norton's is not",
        "IV.D",
        "The torque of a blocked port depends on how it came to rest; the velocity of the free port does not.",
        rows,
        partial(draw_one_source, motor, command),
        "Left: torque at rest, by the side from which rest was reached, and the closed form Km·Ka·c ∓ τc. Right: free "
        "velocity at each command, by the side from which the command was reached.",
    )


def three_branches(motor: MotorExperiment) -> Shown:
    """Within its threshold a shaft on Dahl's contact creeps while the load drive shivers: what is slow enough rests."""
    name = "three branches"
    free, _ = motor.free
    levels = np.round(free[:, 2] / free[:, 2].max(), 2)
    rows = []
    for level in np.unique(levels):
        at = levels == level
        command = float(np.mean(free[at, 2]))
        without_friction = motor.gain * command / motor.damping
        result = mean(free[at, 0])
        if motor.source_rad_s(command) == 0.0:
            result = wider(result, REST_SHARE * float(np.max(free[:, 0])))
        what = f"free velocity at {command / motor.coulomb * motor.gain:.1f} thresholds"
        rows.append(row(name, what, "rad/s", motor.source_rad_s(command), result, without_friction))
    moving = levels > levels.min()
    branch = StraightLine(free[moving, 2], free[moving, 0])
    unit = f"({motor.experiment.rig.command.unit})"
    rows += [
        row(name, "slope of the outer branches", f"rad/s/{unit}", motor.gain / motor.damping, branch.slope, 0.0),
        row(name, "threshold", motor.experiment.rig.command.unit, motor.coulomb / motor.gain, branch.zero(), 0.0),
    ]
    return Shown(
        name,
        "The motion source has three branches",
        "IV.D",
        "ω_N(c) is zero between two thresholds and straight beyond: not invertible, but unambiguous.",
        tuple(rows),
        partial(draw_three_branches, motor),
        "Steady free velocity against command (half differences of either direction, drawn on both sides), and the "
        "closed form.",
    )


def steady_torque(motor: MotorExperiment) -> Shown:
    name, line = "steady torque", motor.steady_line
    command = float(np.mean(motor.steady[:, 2]))
    slope = line.slope
    damping = Estimated(-slope.value, (-slope.interval[1], -slope.interval[0]))
    rows = (
        row(name, "fall of torque with velocity", "N*m*s/rad", motor.damping, damping, 0.0),
        row(name, "velocity without torque", "rad/s", motor.source_rad_s(command), line.zero(), 0.0),
    )
    return Shown(
        name,
        "At constant speed the torque is B (ω_N − ω)",
        "IV.D",
        "While source and port slide one way, friction cancels between them: a damper about the source is left.",
        rows,
        partial(draw_steady_torque, motor),
        "Mean torque at imposed velocities under one command (half differences of both directions), and closed form.",
    )


def inertial_frame(motor: MotorExperiment) -> Shown:
    name, inertia = "inertial frame", motor.experiment.true["inertia"]
    # The amplifier's lag delays the source behind its command.
    lag_s, tick_s = 1.0 / motor.experiment.true["amplifier_bandwidth"], motor.experiment.rig.tick_s
    of_port = wider(motor.inertia(done.OF_PORT), motor.damping * APART * tick_s)
    of_source = wider(motor.inertia(done.OF_SOURCE), motor.damping * (SEEN_LATE * tick_s + lag_s))
    rows = (
        row(name, "inertia shown, the port accelerates", "kg*m^2", inertia, of_port, 0.0),
        row(name, "inertia shown, the source accelerates", "kg*m^2", 0.0, of_source, inertia),
    )
    return Shown(
        name,
        "Inertial torque is not a function of ω_N − ω",
        "IV.D",
        "The port's velocity deviates from the source's by the same, and as fast: once the port accelerates, and once "
        "the source does. The torque of inertia follows the port's motion alone.",
        rows,
        partial(draw_inertial_frame, motor),
        "Torque while the deviation grows and shrinks. Left: the port's velocity goes up and down. Right: the "
        "source's. Closed form: B (ω_N − ω) − Im dω/dt.",
    )


def slow_approach(motor: MotorExperiment) -> Shown:
    name, command = "slow approach", motor.stop_command
    source_nm = motor.damping * motor.source_rad_s(command)
    above = "blocked, with the source's motion: B·ω_N"
    below = "blocked, against it: B·ω_N − 2·τc"
    apart = 2 * motor.coulomb
    rows = (
        row(name, above, "N*m", source_nm, motor.stopped(True).value(0.0), source_nm + apart),
        row(name, below, "N*m", -source_nm - apart, motor.stopped(False).value(0.0), -source_nm),
    )
    return Shown(
        name,
        "Blocked after a slow approach: B ω_N, or B ω_N − 2 τc",
        "IV.D",
        "Which of the two the port shows depends on whether it came to rest with the source's motion or against it.",
        rows,
        partial(draw_slow_approach, motor),
        "Torque at rest against what the load's torque was eased by to stop the creep: the contact springs back in "
        "proportion, and with no easing stands the closed form (squares).",
    )


def _odd(one: Look, other: Look) -> tuple[float, float, float]:
    """Half of the difference of a pair, as if all of it had been done in the positive direction."""
    sign = float(one.label[1])
    return (
        0.5 * sign * (one.velocity_rad_s - other.velocity_rad_s),
        0.5 * sign * (one.torque_nm - other.torque_nm),
        0.5 * sign * (one.command - other.command),
    )


SIDES = (("from above", "v", True), ("from below", "^", False))


def draw_one_source(motor: "MotorExperiment", command: float) -> Figure:
    """Blocked torque and free velocity, each from either side."""
    picture = figure(3.3)
    blocked, free = picture.subplots(1, 2)
    for label, marker, above in SIDES:
        table = motor.stops[above]
        torque = table[:, 0] if above else -table[:, 0]
        _points(blocked, 1e3 * table[:, 1], torque, marker, label)
        expected = motor.gain * command + (-motor.coulomb if above else motor.coulomb)
        blocked.axhline(expected, color=PREDICTED, label="Km·Ka·c ∓ τc" if above else None)
    blocked.set_xlabel("load eased by [mN·m]")
    blocked.set_ylabel("torque at rest [N·m]")
    table, from_below = motor.free
    for label, marker, above in SIDES:
        chosen = from_below != above
        _points(free, table[chosen, 2], table[chosen, 0], marker, label)
    _source(free, motor, float(table[:, 2].max()), 0.0)
    blocked.set_title("Blocked")
    free.set_title("Free")
    blocked.legend(loc="center right")
    free.legend(loc="upper left")
    return picture


def draw_three_branches(motor: "MotorExperiment") -> Figure:
    picture = figure(3.4)
    axes = picture.subplots()
    table, _ = motor.free
    greatest = 1.05 * float(table[:, 2].max())
    _source(axes, motor, greatest, -greatest)
    for sign in (1.0, -1.0):
        _points(axes, sign * table[:, 2], sign * table[:, 0], "o", "measured" if sign > 0 else None)
        label = "τc / (Km·Ka)" if sign > 0 else None
        axes.axvline(sign * motor.coulomb / motor.gain, color=ACCENT, linestyle=(0, (4, 3)), linewidth=0.9, label=label)
    legend(axes)
    return picture


def draw_steady_torque(motor: "MotorExperiment") -> Figure:
    picture = figure(3.2)
    axes = picture.subplots()
    speed, torque, command = motor.steady.T
    source = motor.source_rad_s(float(np.mean(command)))
    reach = np.array([0.0, 1.05 * float(speed.max())])
    axes.plot(reach, motor.damping * (source - reach), color=PREDICTED, label="B (ω_N − ω)")
    axes.axvline(source, color=ACCENT, linestyle=(0, (4, 3)), linewidth=0.9, label="ω_N")
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    _points(axes, speed, torque, "o", "measured")
    axes.set_xlabel("imposed velocity [rad/s]")
    axes.set_ylabel("torque at the port [N·m]")
    legend(axes)
    return picture


def draw_inertial_frame(motor: "MotorExperiment") -> Figure:
    picture = figure(3.3)
    panels = picture.subplots(1, 2, sharey=True)
    titles = ((done.OF_PORT, "The port accelerates"), (done.OF_SOURCE, "The source accelerates"))
    for axes, (moving, title) in zip(panels, titles, strict=True):
        ramps = [each for movement in motor.ramps[moving] for each in movement]
        for sign, marker, meaning in ((1.0, "^", "deviation grows"), (-1.0, "v", "deviation shrinks")):
            chosen = [each for each in ramps if sign * each.rate_rad_s2 > 0.0]
            deviation = np.mean([np.sort(each.deviation_rad_s) for each in chosen], axis=0)
            torque = np.mean([each.torque_nm[np.argsort(each.deviation_rad_s)] for each in chosen], axis=0)
            rate = float(np.mean([each.rate_rad_s2 for each in chosen])) if moving == done.OF_PORT else 0.0
            closed = motor.damping * deviation + motor.experiment.true["inertia"] * rate
            axes.plot(deviation, closed, color=PREDICTED, label="closed form" if sign > 0 else None)
            _points(axes, deviation, torque, marker, meaning)
        axes.set_title(title)
        axes.set_xlabel("ω_N − ω [rad/s]")
    panels[0].set_ylabel("torque at the port [N·m]")
    panels[1].legend(loc="upper left")
    return picture


def draw_slow_approach(motor: "MotorExperiment") -> Figure:
    picture = figure(3.2)
    source_nm = motor.damping * motor.source_rad_s(motor.stop_command)
    panels = picture.subplots(1, 2)
    forms = ((True, "B ω_N", source_nm), (False, "B ω_N − 2 τc", -source_nm - 2 * motor.coulomb))
    for axes, (with_command, name, expected) in zip(panels, forms, strict=True):
        table = motor.stops[with_command]
        reach = np.array([0.0, 1.05 * float(table[:, 1].max())])
        axes.plot(1e3 * reach, motor.stopped(with_command).at(reach), color=MUTED, label="line through all")
        axes.plot([0.0], [expected], marker="s", linestyle="none", color=PREDICTED, label=name)
        _points(axes, 1e3 * table[:, 1], table[:, 0], "o", "measured")
        axes.set_title("command above +τc" if with_command else "command below −τc")
        axes.set_xlabel("load eased by [mN·m]")
        axes.set_ylabel("torque at rest [N·m]")
        axes.legend(loc="lower right")
    return picture


def _source(axes: Axes, motor: "MotorExperiment", greatest: float, least: float) -> None:
    edge = motor.coulomb / motor.gain
    command = np.array(sorted({least, greatest, edge, *((-edge, 0.0) if least < 0.0 else (0.0,))}))
    axes.plot(command, [motor.source_rad_s(each) for each in command], color=PREDICTED, label="ω_N(c)")
    axes.set_xlabel(f"command [{pretty_unit(motor.experiment.rig.command.unit)}]")
    axes.set_ylabel("steady free velocity [rad/s]")


def _points(axes: Axes, x: np.ndarray, y: np.ndarray, marker: str, label: str | None) -> None:
    hollow = "none" if marker == "v" else MEASURED
    axes.plot(
        x, y, linestyle="none", marker=marker, markersize=4.5, markerfacecolor=hollow, markeredgecolor=MEASURED,
        label=label, zorder=3,
    )  # fmt: skip
