"""Stability margins of a loop on benches that differ from the calibrated one."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from norton_bench.arrays import ComplexArray, FloatArray
from norton_bench.control.observer import WIDTH, Observer
from norton_bench.control.regulator import STATES, VELOCITY, Regulator, SampledBench, look_back, sampled

# In rad per tick: from below where the gentlest feedback has its margins.
FREQUENCIES = np.concatenate([np.geomspace(0.002, 0.02, 20, endpoint=False), np.geomspace(0.02, np.pi, 80)])
# The sensor's resonance lies near or beyond half the loop's rate, where it is a sharp peak at a frequency that no
# calibration can know (it is seen folded): it must be stable as it is, but the margins are those of a blunter peak.
LEAST_DAMPING = 0.2
# Poles within this of the unit circle belong to motion that nobody holds: the shafts' common drift.
DRIFT = 5e-4
ROUNDING = 1e-7  # of a pole: what eigenvalues of some hundred numbers are off by


@dataclass(frozen=True)
class Margins:
    """``radius`` of the slowest pole; ``sensitivity``: the peak of |S| at the load's command (1 is no feedback).

    A peak of 2 leaves a gain margin of 2 and a phase margin of 29° at least.
    """

    radius: float
    sensitivity: float

    @property
    def stable(self) -> bool:
        return self.radius < 1.0 + DRIFT

    def within(self, greatest_sensitivity: float) -> bool:
        return self.stable and self.sensitivity <= greatest_sensitivity


@dataclass(frozen=True, eq=False)
class Control:
    """A linear controller of n states: wish = ``direct``·readings + ``wish``·state. See `SampledBench.outputs`."""

    step: FloatArray  # (n, n)
    entry: FloatArray  # (n, 3)
    wish: FloatArray  # (n,)
    direct: FloatArray  # (3,)


def margins(bench: SampledBench, control: Control, tick_s: float) -> Margins:
    """Margins of a controller on ``bench``, with the loop broken at the load's command."""
    loop = np.sum(_bench_response(bench.with_damping(LEAST_DAMPING), tick_s) * _control_response(control), axis=1)
    poles = np.linalg.eigvals(_closed_loop(bench, control, tick_s))
    return Margins(float(np.max(np.abs(poles))), float(np.max(1 / np.abs(1 - loop))))


def unstable_pole(bench: SampledBench, control: Control, tick_s: float) -> complex | None:
    """The pole of what grows fastest from tick to tick in the closed loop; None where nothing does.

    The shafts' common drift is nothing that grows: its poles lie at 1, and rounding moves them a little.
    """
    poles = np.linalg.eigvals(_closed_loop(bench, control, tick_s))
    drifts = np.abs(poles - 1.0) < DRIFT
    beyond = poles[(np.abs(poles) > 1.0 + ROUNDING) & ~drifts]
    return complex(beyond[np.argmax(np.abs(beyond))]) if beyond.size else None


@lru_cache(maxsize=256)
def _bench_response(bench: SampledBench, tick_s: float) -> ComplexArray:
    """From command to readings at FREQUENCIES, (n, 3)."""
    readings, step, entry = _bench_part(bench, tick_s)
    return np.asarray(_resolved(step, entry[:, None], FREQUENCIES)[:, :, 0] @ readings.T)


@lru_cache(maxsize=4)
def _control_response(control: Control) -> ComplexArray:
    return control_response(control, FREQUENCIES)


def control_response(control: Control, frequencies: FloatArray) -> ComplexArray:
    """From readings to wish at ``frequencies`` (n,) in rad per tick; (n, 3)."""
    return np.asarray(control.direct + control.wish @ _resolved(control.step, control.entry, frequencies))


def _resolved(step: FloatArray, entry: FloatArray, frequencies: FloatArray) -> ComplexArray:
    """(z − A)⁻¹ B at these frequencies."""
    z = np.exp(1j * frequencies)[:, None, None]
    return np.asarray(np.linalg.solve(z * np.eye(len(step)) - step, entry[None]))


def _closed_loop(bench: SampledBench, control: Control, tick_s: float) -> FloatArray:
    readings, bench_step, bench_entry = _bench_part(bench, tick_s)
    return np.block(
        [
            [bench_step + np.outer(bench_entry, control.direct @ readings), np.outer(bench_entry, control.wish)],
            [control.entry @ readings, control.step],
        ]
    )


def torque_control(
    observer: Observer, proportional: float, integral_per_s: float, damping_nms_rad: float, tick_s: float
) -> Control:
    """The torque loop, in the form that it runs in: u += P Δτ + I T τ − D Δω, with the observer's ω."""
    body, commands = sizes(observer)
    seen = corrected(observer)
    last_torque, last_velocity = body + commands, body + commands + 1
    wish, memory = np.zeros(body + commands + 2), np.zeros((2, body + commands + 2))
    memory[1, : body + commands] = seen[VELOCITY]
    wish[body] = 1.0
    wish[last_torque], wish[last_velocity] = -proportional, damping_nms_rad
    wish -= damping_nms_rad * memory[1]
    memory_entry = np.stack([[1.0, 0.0, 0.0], observer.gain[VELOCITY]])
    direct = -damping_nms_rad * observer.gain[VELOCITY]
    direct[0] += proportional + integral_per_s * tick_s
    return observing(observer, seen, wish, direct, memory, memory_entry)


def tracking_control(observer: Observer, regulator: Regulator) -> Control:
    """Observer and regulator."""
    body, _ = sizes(observer)
    seen = corrected(observer)
    picked = np.zeros(body)
    picked[: len(regulator.on_state)] = regulator.on_state
    direct, wish = -picked @ observer.gain, -picked @ seen
    wish[body] += 1.0  # the regulator's change is added to the last command
    wish[body : body + len(regulator.on_commands)] -= regulator.on_commands
    return observing(observer, seen, wish, direct, np.zeros((0, len(wish))), np.zeros((0, 3)))


def sizes(observer: Observer) -> tuple[int, int]:
    """How many numbers the predicted states are, and the last commands."""
    return (observer.past + 1) * WIDTH, observer.past + observer.whole + 1


def corrected(observer: Observer) -> FloatArray:
    """The states after the readings, over the predicted states and the last commands; readings as old as nominal."""
    body, commands = sizes(observer)
    return np.eye(body, body + commands) - observer.gain @ _expected(observer, body, commands)


def observing(
    observer: Observer,
    corrected: FloatArray,
    wish: FloatArray,
    direct: FloatArray,
    memory: FloatArray,
    memory_entry: FloatArray,
) -> Control:
    """A controller over the predicted states, the last commands and a memory of its own."""
    body, commands = sizes(observer)
    seen = body + commands
    step, entry = np.zeros((len(wish), len(wish))), np.zeros((len(wish), 3))
    step[:seen, :seen], shift = _register(body, WIDTH, commands)
    flow = observer.step
    entry[:seen] = np.outer(shift, direct)
    step[:WIDTH, :seen] += flow[:, :WIDTH] @ corrected[:WIDTH]
    entry[:WIDTH] += flow[:, :WIDTH] @ observer.gain[:WIDTH]
    step[:WIDTH, body + observer.whole] += flow[:, WIDTH]
    if observer.whole:
        step[:WIDTH, body + observer.whole - 1] += flow[:, WIDTH + 1]
    else:
        step[:WIDTH] += np.outer(flow[:, WIDTH + 1], wish)
        entry[:WIDTH] += np.outer(flow[:, WIDTH + 1], direct)
    step[WIDTH:body, :seen], entry[WIDTH:body] = corrected[: body - WIDTH], observer.gain[: body - WIDTH]
    step[body] = wish
    step[seen:], entry[seen:] = memory, memory_entry
    return Control(step, entry, wish, direct)


@lru_cache(maxsize=256)
def _bench_part(bench: SampledBench, tick_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(readings (3, n), step (n, n), entry (n,)) over the last states and the last commands received."""
    model = sampled(*bench.matrices(), tick_s, bench.command_delay_s)
    past = max(look_back(delay_s, tick_s)[0] for delay_s in bench.delays_s())
    body, commands = (past + 1) * STATES, past + model.whole + 1
    readings = np.zeros((3, body + commands))
    for i, delay_s in enumerate(bench.delays_s()):
        back, after_s = look_back(delay_s, tick_s)
        row = bench.outputs()[i] @ model.flow(after_s)
        readings[i, back * STATES : (back + 1) * STATES] = row[:STATES]
        readings[i, body + back + model.whole] += row[STATES]  # in force: sent 1 + whole ticks before that tick
        readings[i, body + back + model.whole - 1] += row[STATES + 1]
    flow = model.flow(tick_s)
    step, entry = _register(body, STATES, commands)
    step[:STATES, :STATES] = flow[:, :STATES]
    step[:STATES, body + model.whole] += flow[:, STATES]
    if model.whole:
        step[:STATES, body + model.whole - 1] += flow[:, STATES + 1]
    else:
        entry[:STATES] = flow[:, STATES + 1]
    return readings, step, entry


def _register(body: int, width: int, commands: int) -> tuple[FloatArray, FloatArray]:
    """States over commands, each moving one place on at a tick, and where a new command enters."""
    step, entry = np.zeros((body + commands, body + commands)), np.zeros(body + commands)
    step[width:body, : body - width] = np.eye(body - width)
    step[body + 1 :, body:-1] = np.eye(commands - 1)
    entry[body] = 1.0
    return step, entry


def _expected(observer: Observer, body: int, commands: int) -> FloatArray:
    """The readings that the observer expects, (3, body + commands)."""
    rows = np.zeros((3, body + commands))
    for i, (back, instant) in enumerate(observer.nominal):
        row = observer.rows[instant, i]
        rows[i, back * WIDTH : (back + 1) * WIDTH] = row[:WIDTH]
        rows[i, body + back + observer.whole] += row[WIDTH]
        rows[i, body + back + observer.whole - 1] += row[WIDTH + 1]
    return rows
