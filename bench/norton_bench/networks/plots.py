"""Networks in pictures: the source beside the impedance, as a Bode plot or as a map."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.models.network import NortonNetwork
from norton_bench.models.sliding import command_shown, port_torque_nm
from norton_bench.networks.family import Network, commands_of, form_of, kind_of
from norton_bench.networks.kinds import Form
from norton_bench.networks.linear import LinearNetwork
from norton_bench.networks.nonlinear import NonlinearNetwork
from norton_bench.networks.operator import Operator
from norton_bench.networks.settled import SETTLE_S, linearised, middle, static_exertion, static_source

SYMBOLS = {"x_N": "x_N", "v_N": "ω_N", "f_T": "f_T"}
FILES = (".svg", ".png", ".pdf")
LINES = 5
STYLES = ("-", "--", ":")


def plot(network: Network, *, span: float | None = None, settle_s: float = SETTLE_S) -> Figure:
    """Source and impedance of any network; ``span`` is the greatest command shown, in the command's unit.

    ``settle_s`` is how long a nonlinear network with states is given to come to rest.
    """
    picture = Figure(figsize=(8.2, 5.4), layout="constrained")
    left, right = np.ravel(picture.subfigures(1, 2, squeeze=False))
    commands = commands_shown(network, span)
    _source(left.subplots(), network, commands, settle_s)
    if isinstance(network, NortonNetwork):
        _sliding(right.subplots(), network, commands)
    elif isinstance(network, NonlinearNetwork) and _has_map(network):
        _map(right.subplots(), network, commands, settle_s)
    else:
        _bode(right.subplots(2, 1, sharex=True), network, settle_s)
    picture.suptitle(f"{kind_of(network).value.capitalize()} network, {form_of(network).value} form")
    return picture


def save_plot(network: Network, path: Path, *, span: float | None = None, settle_s: float = SETTLE_S) -> None:
    """``plot`` into a file. Raises UsageError where its ending is not a picture's, or the place cannot be had."""
    if path.suffix.lower() not in FILES:
        raise UsageError(f"{path}: cannot draw a {path.suffix or 'file without ending'}; name it {' or '.join(FILES)}")
    try:
        plot(network, span=span, settle_s=settle_s).savefig(path)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror}); choose another place") from error


def commands_shown(network: Network, span: float | None = None) -> FloatArray:
    """The commands of a picture or table: the declared domain, three times a motor's thresholds, or ± ``span``."""
    if span is None and isinstance(network, NonlinearNetwork):
        low, high = network.domain.get(next(iter(network.command_units), ""), (-1.0, 1.0))
        return np.linspace(low, high, 121)
    if span is None:
        span = command_shown(network) if isinstance(network, NortonNetwork) else 1.0
    return np.linspace(-span, span, 121)


def _source(axes: Axes, network: Network, commands: FloatArray, settle_s: float) -> None:
    name, unit = next(iter(commands_of(network).items()), ("c", ""))
    result = static_source(network, commands, settle_s=settle_s)
    axes.plot(result.command, result.value)
    axes.set_xlabel(f"{name} [{unit}]")
    axes.set_ylabel(f"{SYMBOLS[result.quantity]} [{result.unit}]")
    axes.set_title("settled source")


def _sliding(axes: Axes, network: NortonNetwork, commands: FloatArray) -> None:
    """Torque against velocity in steady sliding, for a few commands (section IV.D)."""
    if network.holds_position:
        _pulled(axes, network, commands)
        return
    fastest = float(np.abs(network.source_velocity(commands)).max()) or 1.0
    velocity = np.linspace(-1.5 * fastest, 1.5 * fastest, 301)
    for command in _few(commands):
        axes.plot(velocity, port_torque_nm(network, command, velocity), label=f"c = {command:.3g}")
    axes.plot(network.source_velocity(_few(commands)), np.zeros(LINES), "k.", label="source")
    by_place = any(term.term.periodic for term in network.terms)
    _labelled(axes, "ω [rad/s]", "torque [N m]", "impedance, sliding" + (", mean over a turn" if by_place else ""))


def _pulled(axes: Axes, network: NortonNetwork, commands: FloatArray) -> None:
    """The torque of a servo that holds a position against the angle, at rest, but for friction."""
    most = np.inf if network.torque_limit_nm is None else network.torque_limit_nm
    angle = np.linspace(2.0 * commands[0], 2.0 * commands[-1], 301)
    for command in _few(commands):
        torque = np.clip(network.torque_gain * (command - angle), -most, most)
        axes.plot(angle, torque, label=f"c = {command:.3g}")
    _labelled(axes, "x [rad]", "torque [N m]", "impedance, at rest, without friction")


def _has_map(network: NonlinearNetwork) -> bool:
    return form_of(network) is Form.IMPEDANCE and "x" in network.domain


def _map(axes: Axes, network: NonlinearNetwork, commands: FloatArray, settle_s: float) -> None:
    """Static exertion against place, for a few commands of the source, each under those of the connection (π)."""
    place = np.linspace(*network.domain["x"], 201)
    for number, held in enumerate(_shown(network, commands)):
        everywhere = {name: np.full_like(place, value) for name, value in held.items()}
        axes.plot(
            place,
            static_exertion(network, everywhere, place, settle_s),
            color=f"C{number % LINES}",
            linestyle=STYLES[number // LINES],
            label=", ".join(f"{name} = {value:.3g}" for name, value in held.items()) or None,
        )
    axes.axhline(0.0, color="k", linewidth=0.6)
    _labelled(axes, "x [rad]", "f [N m]", "impedance, static")


def _shown(network: NonlinearNetwork, commands: FloatArray) -> list[dict[str, float]]:
    """A few values of the first command; of the next that the connection takes in (π), ends and middle with each."""
    usual = middle(network)
    if not usual:
        return [usual]
    first, *others = usual
    few = [{**usual, first: float(command)} for command in _few(commands)]
    modulation = next((name for name in others if name in network.connection.inputs and name in network.domain), None)
    if modulation is None:
        return few
    levels = np.linspace(*network.domain[modulation], len(STYLES))
    return [{**held, modulation: float(level)} for level in levels for held in few]


def _bode(axes: Sequence[Axes], network: Network, settle_s: float) -> None:
    connection = _operator(network, settle_s)
    if connection.vanishes:
        raise UsageError(
            "around its settled source the port answers nothing, as beyond the range of a table: there is no "
            "connection to show; convert the network to the other type"
        )
    speeds = np.abs(np.concatenate([connection.poles(), connection.zeros()]))
    speeds = speeds[speeds > 1e-6 * speeds.max(initial=0.0)]
    low, high = (speeds.min(), speeds.max()) if speeds.size else (1.0, 100.0)
    omega = np.geomspace(low / 30.0, high * 30.0, 400)
    response = connection.response(1j * omega)[:, 0]
    impedance = form_of(network) is Form.IMPEDANCE
    name, unit = ("Z", "N m/rad") if impedance else ("Y", "rad/(N m)")
    axes[0].loglog(omega, np.abs(response))
    axes[0].set_ylabel(f"|{name}| [{unit}]")
    axes[0].set_title(f"{form_of(network).value}{'' if isinstance(network, LinearNetwork) else ', linearised'}")
    axes[1].semilogx(omega, np.degrees(np.unwrap(np.angle(response))))
    axes[1].set_ylabel("phase [°]")
    axes[1].set_xlabel("ω [rad/s]")


def _operator(network: Network, settle_s: float) -> Operator:
    if isinstance(network, LinearNetwork):
        return network.connection
    if isinstance(network, NortonNetwork):
        raise UsageError("the motor's impedance is drawn as a map")
    return linearised(network, middle(network), settle_s=settle_s)


def _few(commands: FloatArray) -> FloatArray:
    return np.asarray(commands[np.linspace(0, commands.size - 1, LINES).astype(int)])


def _labelled(axes: Axes, x: str, y: str, title: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title)
    axes.legend(fontsize="small")
