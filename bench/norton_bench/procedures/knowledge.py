"""What the experiment knows so far, passed from procedure to procedure; and how a procedure is carried out."""

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from norton_bench.control.calibration import LoadCalibration
from norton_bench.errors import RigError
from norton_bench.identification.results import FitResult
from norton_bench.loop.bench_loop import Runner
from norton_bench.on_demand import deferred
from norton_bench.records import Measured, join
from norton_bench.rig.rig import Rig
from norton_bench.segments import LoadMode, Segment

if TYPE_CHECKING:
    from norton_bench.procedures.learning import InSitu, Iteration
    from norton_bench.procedures.refinement import Refinement

require_rendered = deferred("norton_bench.control.rendering:require_rendered")  # slow to import, and few have a law
# An imposed velocity may reach this share of the velocity limit: the shaft overshoots a little.
VELOCITY_SHARE = 0.9


@dataclass(frozen=True)
class Tare:
    """The bench at rest.

    ``moving_command`` and ``moving_load_nm`` are what set the shaft in motion, each by itself, if anything did.
    """

    torque_bias_nm: float
    torque_noise_nm: float
    moving_command: float | None = None
    moving_load_nm: float | None = None


@dataclass(frozen=True)
class Knowledge:
    """The results that procedures use; None where there is none yet.

    ``actuator`` is its first fit, from the calibration: good enough for tuning and plans, not a result.
    ``command_span`` holds the commands, negative and positive, at which the free actuator reached the velocity asked.
    ``records`` holds what every procedure so far has measured. ``refinement``, ``iteration`` and ``in_situ`` are
    the states of the last one.
    """

    rig: Rig
    tare: Tare | None = None
    calibration: LoadCalibration | None = None
    actuator: FitResult | None = None
    command_span: tuple[float, float] | None = None
    records: tuple[Measured, ...] = ()
    refinement: "Refinement | None" = None
    iteration: "Iteration | None" = None
    in_situ: "InSitu | None" = None

    @property
    def tick_s(self) -> float:
        return self.rig.tick_s

    def span(self) -> tuple[float, float]:
        """The least and greatest command to use: those of the free shaft, else the limits of the rig."""
        return self.command_span if self.command_span is not None else self.rig.command.span


Plan = Generator[Segment, Measured, None]


class Procedure(Protocol):
    """One step of an experiment: checks the rig, plans segments, and evaluates what was measured in them."""

    @property
    def name(self) -> str: ...

    def require(self, rig: Rig) -> None:
        """Raises RigError, with the reason, before anything moves."""
        ...

    def duration_s(self, rig: Rig) -> float:
        """Estimated duration [s of bench time]."""
        ...

    def plan(self, known: Knowledge) -> Plan:
        """Yields segments; each ``yield`` returns what was measured in it. The drives wait meanwhile: it must be
        quick."""
        ...

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        """The knowledge with the results. Called with the drives idle, so it may take long."""
        ...


@runtime_checkable
class Reporting(Protocol):
    """A procedure that decides something which its recording must contain, so that a later fit decides the same."""

    def recorded_event(self, known: Knowledge) -> tuple[str, str]:
        """Kind and text of the event, after :meth:`conclude`."""
        ...


@runtime_checkable
class Reducing(Protocol):
    """A procedure that makes its plan smaller where the rig's limits demand it, or that promises something of it."""

    def reductions(self, known: Knowledge) -> tuple[str, ...]:
        """Sentences about what it makes smaller and the cost of that, or about what it was certified for; asked before
        it is carried out. Raises ExperimentError where it cannot be."""
        ...


@dataclass(frozen=True)
class Decision:
    """What an adaptive step does next: None when it is done. ``sentence`` is a note for the operator."""

    known: Knowledge
    procedure: Procedure | None
    sentence: str


@runtime_checkable
class Adaptive(Protocol):
    """An adaptive step: procedure after procedure, each chosen from the results so far."""

    @property
    def name(self) -> str: ...

    def require(self, rig: Rig) -> None:
        """Raises RigError, with the reason, before anything moves."""
        ...

    def duration_s(self, rig: Rig) -> float:
        """Greatest duration [s of bench time]."""
        ...

    def following(self, known: Knowledge) -> Decision:
        """The next decision. Called with the drives idle, so it may take long; called again after each procedure."""
        ...


def require_model(rig: Rig, name: str) -> None:
    """Raises RigError where the actuator has no model."""
    if not rig.modelled:
        raise RigError(
            f"{rig.place}: step '{name}' builds on a fitted model, but [actuator] model = \"none\" stands for tables "
            "alone; leave the step out, or name the model"
        )


def refuse_servo(rig: Rig, name: str) -> None:
    """Raises RigError where the actuator's command is a position or a velocity, for a step that moves it as a motor."""
    if rig.servo is not None:
        held = "position" if rig.holds_position else "velocity"
        raise RigError(
            f"{rig.place}: step '{name}' is for a motor, and the command of this actuator is a {held}; leave it out: "
            "'free' and 'imposed' measure a servo"
        )


def require_load(rig: Rig, name: str, why: str) -> None:
    """Raises RigError where the rig has no load drive, or no torque sensor for it to act upon."""
    if rig.wiring.load is None:
        raise RigError(
            f"{rig.place}: step '{name}' needs a load drive {why}; add a [load] section or leave the step out"
        )
    if rig.wiring.torque_sensor is None:
        raise RigError(
            f"{rig.place}: step '{name}' needs a torque sensor at the port; "
            "add a [torque_sensor] section or leave the step out"
        )


def why_no_basis(result: FitResult, what: str) -> str | None:
    """Why nothing can be planned from this fit of ``what``, if nothing can."""
    if not result.converged:
        return f"the fit of {what} did not converge"
    network = result.network
    if min(network.inertia_kgm2, network.coulomb_torque_nm, network.presliding_stiffness_nm_rad) <= 0.0:
        return f"the fit of {what} has an inertia or a friction below zero"
    return None


# Given a segment, and the actuator's position [rad], velocity [rad/s] and command before it, the segment with what can
# be foreseen of it. The position is None before the first segment of a procedure.
Foresight = Callable[[Segment, float | None, float, float], Segment]


def as_it_is(segment: Segment, _position_rad: float | None, _velocity_rad_s: float, _command: float) -> Segment:
    """The segment, unchanged."""
    return segment


def only_rendered(known: Knowledge, foresee: Foresight = as_it_is) -> Foresight:
    """The same foresight, but for segments with a law that the bench cannot render: those raise ExperimentError."""

    def allowed(segment: Segment, position_rad: float | None, velocity_rad_s: float, command: float) -> Segment:
        if segment.mode is LoadMode.ADMITTANCE and segment.admittance.has_body and known.calibration is not None:
            # To look for laws that it can takes seconds: not while the drives are enabled.
            offers = position_rad is None
            require_rendered(known.calibration, known.tick_s, segment.admittance, offers=offers)
        return foresee(segment, position_rad, velocity_rad_s, command)

    return allowed


def carry_out(procedure: Procedure, known: Knowledge, loop: Runner, foresee: Foresight = as_it_is) -> Knowledge:
    """Run one procedure with the drives enabled; then, with the drives idle, evaluate it.

    A law that the bench cannot render is refused. Raises SafetyStopError, OperatorStopError, DeviceError,
    ExperimentError; the drives are idle then, too.
    """
    record = join(list(follow(procedure.plan(known), loop, only_rendered(known, foresee))))
    return replace(procedure.conclude(known, record), records=(*known.records, record))


def follow(plan: Plan, loop: Runner, foresee: Foresight = as_it_is) -> Iterator[Measured]:
    """Run the segments of a plan with the drives enabled; yields the measurements of each. Raises as
    :func:`carry_out`."""
    segment = next(plan, None)
    if segment is not None:
        segment = foresee(segment, None, 0.0, 0.0)  # before the drives are enabled: it may take long
    with loop.running():
        while segment is not None:
            measured = loop.run(segment)
            last = measured.ticks[-1]
            yield measured
            try:
                segment = plan.send(measured)
            except StopIteration:
                break
            start = (float(last[name]) for name in ("position_rad", "velocity_rad_s", "command"))
            segment = foresee(segment, *start)
