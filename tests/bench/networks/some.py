"""Networks that the tests share: the motor, linear ones at random, and the paper's nonlinear examples."""

from dataclasses import replace

from hypothesis import strategies as st

from norton_bench.models.network import NortonNetwork
from norton_bench.models.terms import NetworkTerm
from norton_bench.networks.expressions import Equations
from norton_bench.networks.family import Network
from norton_bench.networks.kinds import Form, Kind
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.motor import as_equations
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.operator import Operator

MOTOR = NortonNetwork(0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, "N*m")
SPRING = 1.5

# Section IV.C.2: a pneumatic muscle against a spring; its source is the root of 0 = (π − θ)² c − K θ.
PNEUMATIC = NonlinearNetwork(
    Kind.NORTON,
    Form.IMPEDANCE,
    Equations(("c",), {"x_N": "(2*pi*c + K - sqrt(K*K + 4*pi*c*K))/(2*c)"}, parameters={"K": SPRING}),
    Equations(("x_N", "x"), {"f": "K*(x_N*(pi - x)**2/(pi - x_N)**2 - x)"}, parameters={"K": SPRING}),
    {"c": "N*m/rad"},
    domain={"x": (0.0, 3.0), "x_N": (0.1, 2.9), "c": (0.1, 2.0)},
)


def in_equations(network: Network) -> Network:
    """The network, an identified motor written out: its own steps take the angle alone, once a tick."""
    return as_equations(network) if isinstance(network, NortonNetwork) else network


def series_elastic(connection: str, **more: object) -> NonlinearNetwork:
    """A positioned spring: a lagging motion source, and ``connection`` of dx and dv as the spring."""
    return NonlinearNetwork(
        Kind.NORTON,
        Form.IMPEDANCE,
        Equations(
            ("c",),
            {"x_N": "place", "v_N": "beta*(c - place)"},
            {"place": "beta*(c - place)"},
            parameters={"beta": 20.0},
        ),
        Equations(("dx", "dv"), {"f": connection}, parameters={"K": 4.0, "B": 0.1, "play": 0.05}),
        {"c": "rad"},
        joined_linearly=True,
        domain={"x": (-1.0, 1.0), "c": (-0.5, 0.5)},
        **more,
    )


# Section VI: a spring between a motion source and the port, which a second command p makes stiffer.
VARIABLE = NonlinearNetwork(
    Kind.NORTON,
    Form.IMPEDANCE,
    Equations(("c",), {"x_N": "place"}, {"place": "beta*(c - place)"}, parameters={"beta": 60.0}),
    Equations(
        ("x_N", "x", "v", "p"),
        {"f": "(k + k1*q)*(x_N - x) + k3*(x_N - x)**3 - b*v"},
        {"q": "lag*(p - q)"},
        parameters={"k": 1.0, "k1": 0.95, "k3": 3.0, "b": 0.05, "lag": 40.0},
    ),
    {"c": "rad", "p": "N*m/rad"},
    domain={"x": (-1.0, 1.0), "c": (-0.5, 0.5), "p": (0.0, 4.0)},
)

# Fig. 1: a pendulum with friction, an exertion source in admittance form.
PENDULUM = NonlinearNetwork(
    Kind.THEVENIN,
    Form.ADMITTANCE,
    Equations(("c",), {"f_T": "c"}),
    Equations(
        ("df",),
        {"x": "theta", "v": "omega", "a": "(df - B*omega - G*sin(theta))/I"},
        {"theta": "omega", "omega": "(df - B*omega - G*sin(theta))/I"},
        parameters={"I": 0.05, "B": 0.1, "G": 0.8},
    ),
    {"c": "N*m"},
    joined_linearly=True,
)

ROOTS = st.floats(0.5, 60.0)
ROOT_LISTS = st.lists(ROOTS, max_size=3)
SCALES = st.floats(0.1, 10.0)


@st.composite
def minimum_phase(draw: st.DrawFn) -> tuple[list[float], list[float]]:
    """Numerator and denominator with all their roots on the left, of any relative degree, proper or not."""
    import numpy as np

    above, below = draw(ROOT_LISTS), draw(ROOT_LISTS)
    return (
        (draw(SCALES) * np.atleast_1d(np.poly([-root for root in above]))).tolist(),
        np.atleast_1d(np.poly([-root for root in below])).tolist(),
    )


@st.composite
def linear_networks(draw: st.DrawFn) -> LinearNetwork:
    """Any type and form, with one or two commands."""
    import numpy as np

    kind, form = draw(st.sampled_from(Kind)), draw(st.sampled_from(Form))
    poles = draw(ROOT_LISTS)
    inputs = draw(st.integers(1, 2))
    rows = draw(st.lists(st.lists(st.floats(-2.0, 2.0), min_size=len(poles), max_size=len(poles)), min_size=inputs,
                         max_size=inputs))  # fmt: skip
    entry = np.array(rows).reshape(inputs, len(poles)).T
    direct = draw(st.lists(st.floats(0.1, 2.0), min_size=inputs, max_size=inputs))
    source = Operator.of(np.diag([-pole for pole in poles]), entry, np.ones(len(poles)), [direct])
    connection = Operator.rational(*draw(minimum_phase()))
    return LinearNetwork(kind, form, source, connection, ("V",) * inputs)


def _with(*terms: NetworkTerm) -> NortonNetwork:
    return replace(MOTOR, terms=terms)


# The motor with each term of the table, and with all of them. Cogging has two waves, one of them not whole in a turn.
COGGING = (NetworkTerm("cogging", (0.004, 0.002), 8), NetworkTerm("cogging", (0.001, -0.002), 3.7))
MOTORS = {
    "stribeck": _with(NetworkTerm("stribeck", (0.008, 2.0))),
    "asymmetry": _with(NetworkTerm("asymmetry", (0.2,))),
    "load": _with(NetworkTerm("load", (0.1,))),
    "friction_by_position": _with(NetworkTerm("friction_by_position", (0.2, -0.1), 6)),
    "saturation": _with(NetworkTerm("saturation", (20.0,))),
    "ripple": _with(NetworkTerm("ripple", (0.1, 0.05), 4)),
    "drag": _with(NetworkTerm("drag", (2e-5,))),
    "cogging": _with(*COGGING),
}
ALL_TERMS = _with(*(term for motor in MOTORS.values() for term in motor.terms))
# The motor behind each joint of the table, and with all other terms behind one.
COMPLIANCE = NetworkTerm("compliance", (8.0, 0.01, 1e-5))
JOINTS = {
    "compliance": _with(COMPLIANCE),
    "backlash": _with(NetworkTerm("backlash", (8.0, 0.01, 1e-5, 2e-3))),
    "compliance with all": replace(ALL_TERMS, terms=(*ALL_TERMS.terms, COMPLIANCE)),
}


def coarser(network):
    """In steps four times as long: the motor's equations then err by less than 1e-10 of its motion, and it takes a
    quarter of the time."""
    return replace(network, step_s=4 * network.step_s)
