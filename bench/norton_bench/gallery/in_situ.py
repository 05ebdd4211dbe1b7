"""The claim of sections V and VI.E: an actuator's source is found while it stays assembled to its load.

The step ``in_situ`` looks at no torque sensor; here one stands between actuator and load all the same, and judges.
"""

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from matplotlib.figure import Figure

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.gallery.claim import PaperExperiment, Shown, mean, row, wider
from norton_bench.identification.at_ticks import in_band, readings_at_ticks
from norton_bench.identification.in_situ import in_band_motion
from norton_bench.identification.trials import TRIAL
from norton_bench.models.network import NortonNetwork
from norton_bench.procedures.in_situ import InSituProcedure
from norton_bench.procedures.options import InSituOptions
from norton_bench.records import SegmentInfo
from norton_bench.report.figures_network import legend
from norton_bench.report.svg import MEASURED, MUTED, PREDICTED, figure

# Four driven trials, for an interval; the first of them is still to be learnt from.
EXPERIMENT = InSituProcedure(InSituOptions(trials=8, duration_s=4.0))
LEARNT_FROM = 1
# What the load is taken for is wrong alike in every trial, which no repetition shows: 30 dB will do.
TOLERANCE = 10 ** (-30 / 20)


@dataclass(frozen=True, eq=False)
class Movement:
    """One trial, arrays (ticks,), in the band that is taught."""

    driven: bool
    torque_nm: FloatArray
    velocity_rad_s: FloatArray


@dataclass(frozen=True)
class Assembled:
    """The true actuator, and what the bench measured while it was assembled."""

    experiment: PaperExperiment

    @cached_property
    def movements(self) -> tuple[Movement, ...]:
        result = tuple(self._movement(each) for each in self._segments)
        if sum(each.driven for each in result) < LEARNT_FROM + 2 or result[0].driven:
            raise ExperimentError("in situ, there were too few trials for an interval; see what stopped them")
        return result

    @property
    def learnt(self) -> list[Movement]:
        return [each for each in self.movements if each.driven][LEARNT_FROM:]

    @property
    def alone(self) -> Movement:
        """The first trial, with the load left to itself."""
        return self.movements[0]

    @cached_property
    def command(self) -> FloatArray:
        first = self._segments[0]
        return np.asarray(self.experiment.measured.between(first.start_ns, first.end_ns).ticks["command"])

    @cached_property
    def source_rad_s(self) -> FloatArray:
        """How the true actuator moves with nothing on its shaft."""
        network = NortonNetwork.of_parameters(self.experiment.true, self.experiment.rig.command.unit)
        position, _, _ = network.free_motion(self.command, self._tick_s)
        return self._velocity(position)

    def torque_left(self, movement: Movement) -> float:
        """What is left of the torque with the load alone, by least squares."""
        return _share(movement.torque_nm, self.alone.torque_nm)

    def motion(self, movement: Movement) -> float:
        """The motion as a share of the source's, by least squares."""
        return _share(movement.velocity_rad_s, self.source_rad_s)

    @property
    def _tick_s(self) -> float:
        return self.experiment.rig.tick_s

    @cached_property
    def _segments(self) -> list[SegmentInfo]:
        segments = self.experiment.measured.segments
        return [each for each in segments if each.procedure == EXPERIMENT.name and each.name.startswith(TRIAL)]

    def _movement(self, segment: SegmentInfo) -> Movement:
        ticks = self.experiment.measured.between(segment.start_ns, segment.end_ns).ticks
        result = readings_at_ticks(self.experiment.measured, segment, len(self.command), self._tick_s)
        if result.torque_nm is None:
            raise ExperimentError("in situ, no torque was read: the gallery needs a torque sensor to judge by")
        return Movement(
            driven=bool(np.any(ticks["load_torque_nm"] != 0.0)),
            torque_nm=in_band(result.torque_nm - np.mean(result.torque_nm), self._tick_s),
            velocity_rad_s=self._velocity(result.position_rad),
        )

    def _velocity(self, position_rad: FloatArray) -> FloatArray:
        return np.asarray(np.gradient(in_band_motion(position_rad, self._tick_s), self._tick_s))


def claims(experiment: PaperExperiment) -> tuple[Shown, ...]:
    """All of them. Raises ExperimentError where the recording lacks what they need."""
    return (in_situ(Assembled(experiment)),)


def in_situ(assembled: Assembled) -> Shown:
    name = "in situ"
    loaded = assembled.motion(assembled.alone)
    torque = mean([assembled.torque_left(each) for each in assembled.learnt])
    motion = mean([assembled.motion(each) for each in assembled.learnt])
    rows = (
        row(name, "torque left, of that with the load alone", "1", 0.0, wider(torque, TOLERANCE), 1.0),
        row(name, "motion, of the actuator's alone", "1", 1.0, wider(motion, TOLERANCE * (1.0 - loaded)), loaded),
    )
    return Shown(
        name,
        "A source is found in situ, by iterating over movements",
        "V, VI.E",
        "The actuator stays assembled to its load; torque is applied to the load until the actuator exerts none. Its "
        "motion is then its source.",
        rows,
        partial(draw_in_situ, assembled),
        "Left: torque between actuator and load in each trial, as the torque sensor saw it and the method did not. "
        "Right: velocity in the first trial, in the last driven one, and of the true actuator alone.",
    )


def _share(of: FloatArray, whole: FloatArray) -> float:
    return float(of @ whole / (whole @ whole))


SIDES = {True: "load given what it needs", False: "load left alone"}


def draw_in_situ(assembled: "Assembled") -> Figure:
    picture = figure(3.4)
    trials, motion = picture.subplots(1, 2)
    numbers = np.arange(1, len(assembled.movements) + 1)
    rms_mnm = np.array([1e3 * np.sqrt(np.mean(each.torque_nm**2)) for each in assembled.movements])
    driven = np.array([each.driven for each in assembled.movements])
    for side, name in SIDES.items():
        chosen, face = driven == side, MEASURED if side else "none"
        trials.semilogy(
            numbers[chosen], rms_mnm[chosen], "o", color=MEASURED, markerfacecolor=face, markersize=4.5, label=name
        )
    trials.set_xlabel("trial")
    trials.set_ylabel("port torque, rms [mN·m]")
    legend(trials)
    time_s = np.arange(len(assembled.command)) * assembled.experiment.rig.tick_s
    motion.plot(time_s, assembled.alone.velocity_rad_s, color=MUTED, linewidth=0.8, label="load left alone")
    motion.plot(time_s, assembled.learnt[-1].velocity_rad_s, color=MEASURED, linewidth=1.4, label="last driven trial")
    motion.plot(time_s, assembled.source_rad_s, color=PREDICTED, linewidth=0.8, label="actuator alone")
    motion.set_xlabel("time [s]")
    motion.set_ylabel("velocity [rad/s]")
    legend(motion)
    return picture
