"""Linear equivalent networks and the exact conversions between their four shapes (paper, section II).

==========  ====================  ===================
type        impedance form        admittance form
==========  ====================  ===================
Thévenin    f = f_T(c) − Z x      x = Y (f_T(c) − f)
Norton      f = Z (x_N(c) − x)    x = x_N(c) − Y f
==========  ====================  ===================

Z = Y⁻¹ and f_T = Z x_N. Exertion f is a torque [N m] and motion x an angle [rad]; power flows out of the network.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from norton_bench.networks.kinds import Form, Kind, NoConversionError
from norton_bench.networks.operator import ComplexArray, Operator, stable


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
            path, what = self.admittance, "the port left free runs away ({}), so it has no motion source"
        else:
            path, what = self.impedance, "the port held still builds up exertion ({}), so it has no exertion source"
        source = path.after(self.source).minimal()
        return _bounded(source, what.format)

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


def _bounded(source: Operator, why: Callable[[str], str]) -> Operator:
    """Raises NoConversionError for a source that grows: what no load could hold, for it lies outside the loop."""
    poles = source.poles()
    if stable(poles):
        return source
    worst = poles[poles.real.argmax()]
    place = f"{worst.real:.4g}" + (f" ± {abs(worst.imag):.4g}i" if abs(worst.imag) > 1e-9 * abs(worst.real) else "")
    raise NoConversionError(f"{why(f'a mode at s = {place} rad/s')}; keep the type that it has")
