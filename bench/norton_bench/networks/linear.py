"""Linear equivalent networks and the exact conversions between their four shapes (paper, section II).

==========  ====================  ===================
type        impedance form        admittance form
==========  ====================  ===================
Thévenin    f = f_T(c) − Z x      x = Y (f_T(c) − f)
Norton      f = Z (x_N(c) − x)    x = x_N(c) − Y f
==========  ====================  ===================

Z = Y⁻¹ and f_T = Z x_N. Exertion f is a torque [N m] and motion x an angle [rad]; power flows out of the network.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

from norton_bench.arrays import ComplexArray, FloatArray
from norton_bench.errors import UsageError
from norton_bench.networks.kinds import Form, Kind, Load, NoConversionError
from norton_bench.networks.operator import Operator, stable


@dataclass(frozen=True)
class LinearNetwork:
    """``source``: commands to f_T [N m] or x_N [rad]; ``connection``: Z [N m/rad] or Y [rad/(N m)] of one input.

    ``command_units`` has one unit for each input of the source. Raises ValueError, in a sentence, for other shapes.
    """

    kind: Kind
    form: Form
    source: Operator
    connection: Operator
    command_units: tuple[str, ...]
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.connection.inputs != 1:
            raise ValueError(f"a connection has one input, the port; this one has {self.connection.inputs}")
        if self.source.inputs != len(self.command_units):
            raise ValueError(
                f"the source takes {self.source.inputs} commands, but {len(self.command_units)} units are given"
            )

    @classmethod
    def of_velocity(
        cls, kind: Kind, form: Form, source: Operator, connection: Operator, command_units: tuple[str, ...]
    ) -> "LinearNetwork":
        """A network whose motion is a velocity [rad/s], in terms of the angle: integrators and differentiators join."""
        to_angle = source.integrated() if kind is Kind.NORTON else source
        angled = connection.differentiated() if form is Form.IMPEDANCE else connection.integrated()
        return cls(kind, form, to_angle, angled, command_units)

    @property
    def commands(self) -> dict[str, str]:
        """The unit of each command, by name: c, or c1, c2, … where there are several."""
        several = len(self.command_units) > 1
        return {f"c{place}" if several else "c": unit for place, unit in enumerate(self.command_units, start=1)}

    @property
    def impedance(self) -> Operator:
        """Z: motion in, exertion out. Raises NoConversionError where the admittance is zero."""
        return self.connection if self.form is Form.IMPEDANCE else _inverse(self.connection, "admittance")

    @property
    def admittance(self) -> Operator:
        """Y: exertion in, motion out. Raises NoConversionError where the impedance is zero."""
        return self.connection if self.form is Form.ADMITTANCE else _inverse(self.connection, "impedance")

    def converted(self, kind: Kind, form: Form) -> "LinearNetwork":
        """The equivalent network of another type or form, exact; what cancels in it is taken out.

        Raises NoConversionError, in a sentence that says why, where there is none.
        """
        source = self.source if kind is self.kind else self._other_source()
        connection = self.impedance if form is Form.IMPEDANCE else self.admittance
        return replace(self, kind=kind, form=form, source=source, connection=connection)

    def _other_source(self) -> Operator:
        if self.kind is Kind.THEVENIN:
            return bounded(self.admittance.after(self.source).minimal(), Kind.NORTON)
        return bounded(self.impedance.after(self.source).minimal(), Kind.THEVENIN)

    def with_provenance(self, provenance: Mapping[str, str]) -> "LinearNetwork":
        """The same network, with more said of where it comes from."""
        return replace(self, provenance={**self.provenance, **provenance})

    def response(self, s: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Source (k, m) and connection (k,) at complex frequencies ``s`` [rad/s]."""
        return self.source.response(s), self.connection.response(s)[:, 0]


def _inverse(connection: Operator, name: str) -> Operator:
    try:
        return connection.inverse()
    except ZeroDivisionError:
        ideal = "exertion" if name == "impedance" else "motion"
        other = "admittance" if name == "impedance" else "impedance"
        raise NoConversionError(
            f"the {name} is zero: an ideal {ideal} source has no {other}, so keep it in the form that it is in"
        ) from None


_RUNS_AWAY = {
    Kind.NORTON: "the port left free runs away (a mode at s = {} rad/s), so it has no motion source",
    Kind.THEVENIN: "the port held still builds up exertion (a mode at s = {} rad/s), so it has no exertion source",
}


def bounded(source: Operator, kind: Kind) -> Operator:
    """Raises NoConversionError for a source that grows: what no load could hold, for it lies outside the loop."""
    poles = source.poles()
    if stable(poles):
        return source
    worst = poles[poles.real.argmax()]
    place = f"{worst.real:.4g}" + (f" ± {abs(worst.imag):.4g}i" if abs(worst.imag) > 1e-9 * abs(worst.real) else "")
    raise NoConversionError(f"{_RUNS_AWAY[kind].format(place)}; keep the type that it has")


# Linear networks in time: exact for commands that are held from tick to tick and port signals linear in between.
def joint(network: LinearNetwork) -> Operator:
    """The network as one operator: commands and, last, the port's input (x or f); out comes the other (f or x)."""
    source, connection = network.source, network.connection
    if (network.kind is Kind.NORTON) == (network.form is Form.IMPEDANCE):
        deviation = widened(source, after=1) + widened(Operator.gains(-1.0), before=source.inputs)
        return connection.after(deviation)
    return widened(source, after=1) + widened(-connection, before=source.inputs)


def respond(operator: Operator, commands: FloatArray, port: FloatArray, tick_s: float) -> FloatArray:
    """Output at the ticks (n,) from rest: ``commands`` (n, m) held, ``port`` (k, n) a signal and its derivatives.

    Raises UsageError, in a sentence, where the output contains derivatives that neither has.
    """
    m, ticks = commands.shape[1], len(commands)
    check_derivatives(operator, m, len(port))
    rows = operator.direct.shape[0]
    output = commands @ operator.direct[0, :m]
    if operator.inputs > m:
        output = output + operator.direct[:, m] @ port[:rows]
    if not operator.order:
        return np.asarray(output)
    step = _steps(operator, m, tick_s)
    slope = np.diff(port[0], append=port[0, -1]) / tick_s if operator.inputs > m else np.zeros(ticks)
    signal = port[0] if operator.inputs > m else np.zeros(ticks)
    state = np.zeros(operator.order)
    for k in range(ticks):
        output[k] += operator.exit @ state
        state = step @ np.concatenate([state, commands[k], [signal[k], slope[k]]])
    return np.asarray(output)


def coupled(
    network: LinearNetwork, commands: FloatArray, load: Load, tick_s: float
) -> tuple[FloatArray, FloatArray | None]:
    """Angle [rad] and exertion [N m] at the ticks, from rest, with the load at the port; ``commands`` is (n, m).

    No exertion is given where it answers to the command's derivative: a step of the command would be a blow.
    """
    beyond = Operator.polynomial(load.stiffness_nm_rad, load.damping_nms_rad, load.inertia_kgm2)
    angle = closed_loop(network, beyond)
    exertion = beyond.after(angle).minimal()
    none = np.zeros((1, len(commands)))
    position = respond(angle, commands, none, tick_s)
    return position, None if exertion.derivatives else respond(exertion, commands, none, tick_s)


def closed_loop(network: LinearNetwork, load: Operator) -> Operator:
    """Commands to the angle of the port with ``load`` (an impedance) on it, by the network's own type and form."""
    source = network.source
    if (network.kind is Kind.NORTON) == (network.form is Form.IMPEDANCE):
        source = network.connection.after(source)
    loop = (
        network.connection + load
        if network.form is Form.IMPEDANCE
        else Operator.gains(1.0) + network.connection.after(load)
    )
    try:
        return loop.inverse().after(source).minimal()
    except ZeroDivisionError:
        raise UsageError(
            "the load cancels the network's impedance: no motion is determined; give another load"
        ) from None


def as_commands(command: npt.ArrayLike, inputs: int) -> FloatArray:
    """Commands (n, m) from (n,) or (n, m). Raises UsageError where the number of inputs is another."""
    commands = np.asarray(command, dtype=float)
    commands = commands[:, None] if commands.ndim == 1 else commands
    if commands.ndim != 2 or commands.shape[1] != inputs:
        raise UsageError(f"the network has {inputs} command inputs, but commands of shape {commands.shape} were given")
    return commands


def check_derivatives(operator: Operator, m: int, known: int) -> None:
    """Raises UsageError where the output contains derivatives beyond the ``known`` signals, or any of a command."""
    if operator.direct[1:, :m].any():
        raise UsageError(
            "this type of network answers to the command's derivative, which a command held from tick to tick has not; "
            "convert it to the other type"
        )
    if operator.inputs > m and operator.direct[known:, m].any():
        raise UsageError(
            f"this form answers to derivative {operator.derivatives} of what goes in at the port, and "
            f"{known - 1} are known; convert it to the other form"
        )


def _steps(operator: Operator, m: int, tick_s: float) -> FloatArray:
    """(n, n + m + 2): state, held commands, port and its slope to the state a tick later."""
    n, width = operator.order, operator.order + m + 2
    flow = np.zeros((width, width))
    flow[:n, :n] = operator.state
    flow[:n, n : n + operator.inputs] = operator.entry
    flow[n + m, n + m + 1] = 1.0
    return np.asarray(expm(flow * tick_s)[:n])


def widened(operator: Operator, before: int = 0, after: int = 0) -> Operator:
    """The same operator with inputs beside its own that it does not mind."""
    sides = ((0, 0), (before, after))
    return Operator(operator.state, np.pad(operator.entry, sides), operator.exit, np.pad(operator.direct, sides))
