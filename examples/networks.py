"""Networks as objects: a series-elastic actuator in its four shapes, a muscle, and an arm that is put together.

python examples/networks.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

from norton_bench.networks.algebra import Carried, element, in_series, outward
from norton_bench.networks.checks import check
from norton_bench.networks.equivalents import with_port_source
from norton_bench.networks.expressions import Equations
from norton_bench.networks.family import converted, coupled, exertion
from norton_bench.networks.files import load, save
from norton_bench.networks.kinds import Form, Kind, Load, Motion, NoConversionError
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.operator import Operator
from norton_bench.networks.settled import static_source

TICK_S = 1e-3


def series_elastic() -> LinearNetwork:
    """A position drive of 50 rad/s behind a spring of 3 N m/rad and a damper."""
    source = Operator.rational([50.0], [1.0, 50.0])
    return LinearNetwork(Kind.NORTON, Form.IMPEDANCE, source, Operator.polynomial(3.0, 0.1), ("rad",))


def muscle() -> NonlinearNetwork:
    """A pneumatic muscle against a spring (paper, section IV.C.2): f = Z(x_N, x)."""
    spring = {"K": 1.5}
    source = Equations(("c",), {"x_N": "(2*pi*c + K - sqrt(K*K + 4*pi*c*K))/(2*c)"}, parameters=spring)
    connection = Equations(("x_N", "x"), {"f": "K*(x_N*(pi - x)**2/(pi - x_N)**2 - x)"}, parameters=spring)
    domain = {"x": (0.0, 3.0), "x_N": (0.1, 2.9), "c": (0.1, 2.0)}
    return NonlinearNetwork(Kind.NORTON, Form.IMPEDANCE, source, connection, {"c": "N*m/rad"}, domain=domain)


def main(folder: Path) -> None:
    elastic = series_elastic()
    command = np.full(1000, 0.4)
    for kind in Kind:
        for form in Form:
            shape = converted(elastic, kind, form)
            place = coupled(shape, command, Load(inertia_kgm2=0.02, stiffness_nm_rad=3.0), TICK_S).position_rad[-1]
            print(f"{kind.value}, {form.value}: a load of the same stiffness is moved to {place:.3f} rad")
    path = folder / "muscle.network.json"
    save(muscle(), path)
    network = load(path)
    for finding in check(network):
        print(f"{finding.condition}: {finding.holds}: {finding.why}")
    rests = static_source(network, [0.5]).value[0]
    blocked = [exertion(network, [0.5], Motion.still(1, place), TICK_S)[0] for place in (0.5, 1.0)]
    print(f"at c = 0.5 the free port rests at {rests:.3f} rad")
    print(f"blocked at 0.5 and 1 rad it exerts {blocked[0]:.3f} and {blocked[1]:.3f} N m")
    thevenin = converted(network, Kind.THEVENIN, Form.IMPEDANCE)
    print(f"as Thévenin's network: {thevenin.provenance['source']}")
    arm = with_port_source(outward(elastic, Carried(element("J*a + G*sin(x)", J=0.02, G=0.5))))
    free = coupled(arm, np.full(4000, 0.4), Load(), TICK_S)
    print(f"free, the arm with its weight moves to {free.position_rad[-1]:.3f} rad")
    try:
        in_series(network, network)
    except NoConversionError as error:
        print(f"two muscles in series: {error}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
