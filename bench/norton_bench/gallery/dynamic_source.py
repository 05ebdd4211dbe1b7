"""The claim about a muscle whose command swings (IV.C.2): the free port's motion is the source, and follows
I θ̈_N + K θ_N = (π − θ_N)² c, whatever the impedance."""

from dataclasses import dataclass
from functools import cached_property, partial
from math import pi
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure
from numba import njit

from norton_bench.arrays import FloatArray
from norton_bench.gallery.claim import PaperExperiment, Shown, mean, row, wider
from norton_bench.identification.at_ticks import readings_at_ticks, sent_at_ticks
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.waves import hold, ramp, zero_torque
from norton_bench.records import Measured, SegmentInfo
from norton_bench.report.figures_network import legend
from norton_bench.report.svg import MEASURED, MUTED, PREDICTED, figure
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

# The command's middle and swing, as shares of the greatest. The shipped muscle resonates at 4.3 Hz.
MIDDLE, SWING, SWING_HZ = 0.6, 0.2, 3.0
# What the first cycles leave has then died away; the next ones are compared.
LEAD_CYCLES, CYCLES = 5, 12
LEAVE_S, SETTLE_S = 0.5, 0.6
SWINGS = "swing"
# Between a command and the reading of what it did are up to this many ticks.
TICKS_APART = 2
# Of the equation, within a tick: the contact of the shipped muscle follows within 0.2 ms.
STEPS = 10


@dataclass(frozen=True)
class SwungCommand:
    """The command swings, and the torque at the port is held at zero."""

    rounds: int = 5
    name: ClassVar[str] = "gallery dynamic source"

    def require(self, rig: Rig) -> None:
        require_load(rig, self.name, "to hold the torque at the port at zero")

    def duration_s(self, rig: Rig) -> float:
        return self.rounds * (2 * LEAVE_S + SETTLE_S + (LEAD_CYCLES + CYCLES) / SWING_HZ)

    def plan(self, known: Knowledge) -> Plan:
        rig, tick_s = known.rig, known.tick_s
        middle, swing = MIDDLE * rig.command.limit, SWING * rig.command.limit
        time_s = np.arange(1, round((LEAD_CYCLES + CYCLES) / SWING_HZ / tick_s) + 1) * tick_s
        command = middle + swing * np.sin(2 * pi * SWING_HZ * time_s)
        there, back = ramp(0.0, middle, LEAVE_S, tick_s), ramp(middle, 0.0, LEAVE_S, tick_s)
        for _ in range(self.rounds):
            yield zero_torque(self.name, "settle", Use.PREPARE, np.append(there, hold(middle, SETTLE_S, tick_s)), rig)
            yield zero_torque(self.name, SWINGS, Use.PREPARE, command, rig)
            yield zero_torque(self.name, "leave", Use.PREPARE, back, rig)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known


@dataclass(frozen=True, eq=False)
class Swing:
    """One round at its ticks, arrays of shape (ticks,): commands, and what was read at the port."""

    command: FloatArray
    position_rad: FloatArray
    torque_nm: FloatArray


@dataclass(frozen=True)
class SwungMuscle:
    """The true muscle and its source while the command swings."""

    experiment: PaperExperiment

    @property
    def tick_s(self) -> float:
        return self.experiment.rig.tick_s

    @cached_property
    def swings(self) -> tuple[Swing, ...]:
        return tuple(map(self._swing, self.experiment.segments(SwungCommand.name, SWINGS)))

    def _swing(self, segment: SegmentInfo) -> Swing:
        measured, tick_s = self.experiment.measured, self.tick_s
        ticks = round((segment.end_ns - segment.start_ns) * 1e-9 / tick_s)
        readings = readings_at_ticks(measured, segment, ticks, tick_s)
        assert readings.torque_nm is not None  # the rig has a torque sensor: it was tared
        torque_nm = readings.torque_nm - self.experiment.torque_zero_nm
        return Swing(sent_at_ticks(measured, segment, "command", ticks, tick_s), readings.position_rad, torque_nm)

    def static_rad(self, command: FloatArray) -> FloatArray:
        """The root between 0 and π of 0 = (π − θ)² c − K θ."""
        half = pi + self.experiment.true["spring"] / (2 * command)
        return np.asarray(half - np.sqrt(half * half - pi * pi))

    @cached_property
    def sources_rad(self) -> tuple[FloatArray, ...]:
        """θ_N(t) of each round by the closed form (ticks,)."""
        return tuple(map(self._source_rad, self.swings))

    def _source_rad(self, swing: Swing) -> FloatArray:
        """Under the commands as sent and the torque that was left at the port.

        The body has the friction of the plant (Dahl), and the pressure follows its command with a lag.
        """
        names = ("spring", "output_inertia", "output_viscous_damping", "output_coulomb_torque")
        contact = ("output_presliding_stiffness", "output_presliding_damping", "amplifier_bandwidth")
        true = np.array([self.experiment.true[name] for name in (*names, *contact)])
        start = np.array([swing.position_rad[0], 0.0, 0.0, swing.command[0]])
        return driven(true, start, swing.command, swing.torque_nm, self.tick_s)

    def wave(self, swing: Swing, position_rad: FloatArray) -> complex:
        """The motion's part at the command's frequency over that of the command [rad per unit of command]."""
        compared = slice(len(swing.command) - round(CYCLES / SWING_HZ / self.tick_s), None)
        turning = np.exp(-2j * pi * SWING_HZ * self.tick_s * np.arange(len(swing.command)))[compared]
        return complex(np.sum(turning * position_rad[compared]) / np.sum(turning * swing.command[compared]))


@njit(cache=True)
def driven(
    true: FloatArray, start: FloatArray, command: FloatArray, torque_nm: FloatArray, tick_s: float
) -> FloatArray:
    """The angle at the ticks (ticks,), by Runge and Kutta's method of fourth order.

    ``true`` holds spring, inertia, damping, Coulomb torque, stiffness and damping of the contact, and the rate of the
    pressure; the state is angle, velocity, contact's deflection and the pressure's command.
    """
    step_s = tick_s / STEPS
    state, path = start.copy(), np.empty(command.size)
    for tick in range(command.size):
        path[tick] = state[0]
        for _ in range(STEPS):
            first = _rates(true, state, command[tick], torque_nm[tick])
            second = _rates(true, state + 0.5 * step_s * first, command[tick], torque_nm[tick])
            third = _rates(true, state + 0.5 * step_s * second, command[tick], torque_nm[tick])
            last = _rates(true, state + step_s * third, command[tick], torque_nm[tick])
            state += step_s / 6.0 * (first + 2.0 * second + 2.0 * third + last)
    return path


@njit(cache=True)
def _rates(true: FloatArray, state: FloatArray, command: float, torque_nm: float) -> FloatArray:
    spring, inertia, damping, coulomb_nm, stiffness, contact_damping, lag = true
    angle, velocity, contact, pressure = state
    slip = velocity - stiffness / coulomb_nm * abs(velocity) * contact
    friction_nm = stiffness * contact + contact_damping * slip + damping * velocity
    pull_nm = (pi - angle) ** 2 * pressure - spring * angle
    return np.array([velocity, (pull_nm - friction_nm - torque_nm) / inertia, slip, lag * (command - pressure)])


def dynamic_source(muscle: SwungMuscle) -> Shown:
    measured = [muscle.wave(each, each.position_rad) for each in muscle.swings]
    expected = complex(np.mean([muscle.wave(*each) for each in zip(muscle.swings, muscle.sources_rad, strict=True)]))
    static = muscle.wave(muscle.swings[0], muscle.static_rad(muscle.swings[0].command))
    swing = SWING * muscle.experiment.rig.command.limit
    apart_rad = 2 * pi * SWING_HZ * TICKS_APART * muscle.tick_s
    name = "dynamic source"
    amplitudes = mean([swing * abs(each) for each in measured])
    lags = wider(mean([-np.angle(each) for each in measured]), apart_rad)
    rows = (
        row(name, "amplitude of the free port", "rad", swing * abs(expected), amplitudes, swing * abs(static)),
        row(name, "lag behind the command", "rad", -float(np.angle(expected)), lags, -float(np.angle(static))),
    )
    return Shown(
        name,
        "A motion source has dynamics of its own",
        "IV.C.2",
        "With no torque at the port, its motion follows from the command alone, I θ̈_N + K θ_N = (π − θ_N)² c: the "
        "forward path's dynamics, found without knowing the impedance.",
        rows,
        partial(draw, muscle),
        "Two cycles of the free port under a swinging command, its equation with the true values (and with the plant's "
        "friction and lag of pressure), and what would be if the source followed at once.",
    )


def draw(muscle: SwungMuscle) -> Figure:
    picture = figure(3.4)
    axes = picture.subplots()
    swing = muscle.swings[0]
    shown = slice(len(swing.command) - round(2 / SWING_HZ / muscle.tick_s), None)
    time_s = np.arange(len(swing.command))[shown] * muscle.tick_s
    time_s = time_s - time_s[0]
    static = muscle.static_rad(swing.command)[shown]
    axes.plot(time_s, static, color=MUTED, linestyle=(0, (4, 3)), label="a source without dynamics")
    axes.plot(
        time_s[::12], swing.position_rad[shown][::12], linestyle="none", marker="o", markersize=3.5, color=MEASURED,
        label="measured",
    )  # fmt: skip
    axes.plot(time_s, muscle.sources_rad[0][shown], color=PREDICTED, label="I θ̈_N + K θ_N = (π − θ_N)² c")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("position of the port [rad]")
    legend(axes)
    return picture
