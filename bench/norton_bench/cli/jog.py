"""``jog``: the bench moved by hand on the screen, or to given values and back without it."""

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import RUNS, Backend, Json, Out, Quiet, RigFile, Seed, run_folder, value_in
from norton_bench.cli.output import Output, plain_table
from norton_bench.errors import ExitCode, UsageError

if TYPE_CHECKING:
    from rich.table import Table

    from norton_bench.jog.hands import Bounds, Preset, Setpoints
    from norton_bench.jog.signals import HeldSignals, SignalValue
    from norton_bench.rig.rig import Rig

DURATION = "2 s"
Actuator = Annotated[str | None, Parameter(help="Actuator command, in the rig's unit: 0.02, or --actuator=-0.02.")]
LoadTorque = Annotated[str | None, Parameter(help='Torque of the load: "0.05 N*m".')]
LoadVelocity = Annotated[
    str | None, Parameter(help='Velocity that the load imposes: "5 rad/s". The load is calibrated first, for 20 s.')
]
ZeroTorque = Annotated[
    bool, Parameter(help="The load keeps the port at zero torque. It is calibrated first, for 20 s.")
]
Body = Annotated[
    str | None,
    Parameter(
        help="Mass, damping and stiffness that the load acts at the port; what is not given is zero. The load is "
        "calibrated first, for 20 s."
    ),
]
Wall = Annotated[str | None, Parameter(help="The stiffness acts only beyond this angle from where the shaft stands.")]
Duration = Annotated[
    str | None, Parameter(help=f'How long the values are held, upward ramps included; default "{DURATION}".')
]
Speed = Annotated[
    str | None,
    Parameter(help="Speed of the shaft at which torques are switched off; default: half of [limits] velocity."),
]
DeadMan = Annotated[
    str | None,
    Parameter(help='On the screen: after this time without a key everything returns to zero; default "10 s".'),
]


def jog(
    rig_file: RigFile,
    /,
    *,
    actuator: Actuator = None,
    load_torque: LoadTorque = None,
    load_velocity: LoadVelocity = None,
    zero_torque: ZeroTorque = False,
    mass: Body = None,
    damping: Body = None,
    stiffness: Body = None,
    wall: Wall = None,
    duration: Duration = None,
    speed: Speed = None,
    dead_man: DeadMan = None,
    backend: Backend = None,
    seed: Seed = None,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Move a bench by hand: nudge torques and velocities, watch every signal. On the screen, or with values without it.

    Drives are enabled at zero and ramp to the values given, within the rig's limits; afterwards back to zero, and idle.
    """
    from norton_bench.jog.hands import bounds_of  # noqa: PLC0415
    from norton_bench.rig.load import load_rig  # noqa: PLC0415

    rig = load_rig(rig_file, backend=backend)
    speed_rad_s = None if speed is None else value_in("--speed", speed, "rad/s")
    bounds = bounds_of(rig, speed_rad_s)
    given = {"actuator": actuator, "load_torque": load_torque, "load_velocity": load_velocity}
    given |= {"mass": mass, "damping": damping, "stiffness": stiffness, "wall": wall}
    if all(value is None for value in given.values()) and not zero_torque:
        if duration is not None or json:
            raise UsageError(
                "--duration and --json need values, such as --actuator 0.02; without values jog opens the screen"
            )
        dead_man_s = None if dead_man is None else value_in("--dead-man", dead_man, "s")
        return _on_screen(rig_file, rig, speed_rad_s, dead_man_s, backend, seed, out)
    if dead_man is not None:
        raise UsageError("--dead-man is for the screen; with values, --duration sets when everything returns to zero")
    setpoints = _setpoints(rig, bounds, given, zero_torque=zero_torque)
    duration_s = value_in("--duration", duration or DURATION, "s")
    return _to(setpoints, duration_s, rig, bounds, run_folder(out, rig.name), seed, Output(json, quiet))


def _setpoints(rig: "Rig", bounds: "Bounds", given: dict[str, str | None], *, zero_torque: bool) -> "Setpoints":
    """Raises UsageError for values that contradict each other, exceed a limit, or are not possible on this rig."""
    from norton_bench.jog.hands import LoadDoes, Setpoints, unlimited  # noqa: PLC0415
    from norton_bench.procedures.knowledge import require_load  # noqa: PLC0415
    from norton_bench.segments import LAW_UNITS, Admittance  # noqa: PLC0415

    torque, velocity = given["load_torque"], given["load_velocity"]
    body = any(given[name] is not None for name in (*LAW_UNITS, "wall"))
    if (torque is not None) + (velocity is not None) + zero_torque + body > 1:
        raise UsageError(
            "--load-torque, --load-velocity, --zero-torque, and a body's --mass, --damping and --stiffness: the load "
            "can do only one of them at a time"
        )
    command = 0.0 if given["actuator"] is None else value_in("--actuator", given["actuator"], rig.command.unit)
    setpoints = Setpoints(command)
    if torque is not None:
        if rig.wiring.load is None:
            raise UsageError(f"{rig.place}: --load-torque needs a load drive; this rig has none")
        setpoints = Setpoints(command, LoadDoes.TORQUE, value_in("--load-torque", torque, "N*m"))
    elif body:
        require_load(rig, "calibrate", "for --mass, --damping and --stiffness")
        values = (value_in(f"--{name}", given[name] or "0", unit) for name, unit in LAW_UNITS.items())
        wall_rad = None if given["wall"] is None else value_in("--wall", given["wall"], "rad")
        setpoints = Setpoints(command, LoadDoes.BODY, law=Admittance.of(values, wall_rad))
        if setpoints.law.shortcoming:
            raise UsageError(f"--mass, --damping, --stiffness and --wall: {setpoints.law.shortcoming}")
        if not setpoints.law.has_body:
            raise UsageError("--mass, --damping and --stiffness are all zero; for zero torque --zero-torque")
    elif velocity is not None or zero_torque:
        require_load(rig, "calibrate", "for --load-velocity and --zero-torque")
        value = 0.0 if velocity is None else value_in("--load-velocity", velocity, "rad/s")
        setpoints = Setpoints(command, LoadDoes.ZERO_TORQUE if zero_torque else LoadDoes.VELOCITY, value)
    if unlimited(bounds, setpoints.load):
        raise UsageError(f"{rig.place}: the load's torque has no limit; write [load] torque_limit, then jog")
    _, beyond = bounds.clamped(setpoints)
    if beyond:
        raise UsageError(f"{setpoints.words(rig.command.unit)}: {beyond}")
    return setpoints


def _to(
    setpoints: "Setpoints",
    duration_s: float,
    rig: "Rig",
    bounds: "Bounds",
    folder: Path,
    seed: int | None,
    output: Output,
) -> int:
    from norton_bench.cli.progress import PREPARING  # noqa: PLC0415
    from norton_bench.events import SessionEvent, SessionState, StateChanged  # noqa: PLC0415
    from norton_bench.jog.hands import Preset  # noqa: PLC0415
    from norton_bench.jog.script import JogScript  # noqa: PLC0415
    from norton_bench.jog.signals import HeldSignals  # noqa: PLC0415
    from norton_bench.loop.stop_word import operator_stop  # noqa: PLC0415
    from norton_bench.session.engine import run_by_hand  # noqa: PLC0415
    from norton_bench.session.operator import Nobody  # noqa: PLC0415

    held = HeldSignals(rig, setpoints.words(rig.command.unit), output.say)
    hand = Preset(setpoints, duration_s)

    def on_event(event: SessionEvent) -> None:
        held(event)
        match event:
            case StateChanged(SessionState.PREPARING):
                output.say(PREPARING)
            case StateChanged(SessionState.RUNNING):
                stops = f"torques are switched off at {bounds.speed_rad_s:.4g} rad/s"
                output.say(f"moving: {held.words}, for {duration_s:g} s; {stops}")

    with operator_stop() as stop:
        recording = run_by_hand(
            rig, JogScript(bounds, hand), out=folder, seed=seed, on_event=on_event, operator=Nobody(stop)
        )
    return _show(hand, held, recording, output)


def _show(hand: "Preset", held: "HeldSignals", recording: Path, output: Output) -> int:
    signals = held.signals.seen()
    data: dict[str, Any] = {
        "setpoints": held.words,
        "cut_short": hand.cut_short or None,
        "signals": [signal.__dict__ for signal in signals],
        "recording": recording,
    }
    output.result(data, _table(signals), f"\nrecording: {recording}")
    if hand.cut_short:
        output.say(hand.cut_short)
    return ExitCode.EXPERIMENT_FAILED if hand.cut_short else ExitCode.OK


def _table(signals: "tuple[SignalValue, ...]") -> "Table":
    table = plain_table()
    for name in ("device", "signal"):
        table.add_column(name)
    for name in ("at last", "least", "greatest"):
        table.add_column(name, justify="right")
    table.add_column("unit")
    for seen in signals:
        numbers = (
            f"{value + 0.0:.5g}" if isfinite(value) else "–" for value in (seen.value, seen.least, seen.greatest)
        )
        table.add_row(seen.device, seen.name, *numbers, seen.unit)
    return table


def _on_screen(
    rig_file: Path,
    rig: "Rig",
    speed_rad_s: float | None,
    dead_man_s: float | None,
    backend: str | None,
    seed: int | None,
    out: Path | None,
) -> int:
    from norton_bench.cli.screen import require_terminal, show  # noqa: PLC0415
    from norton_bench.jog.by_hand import Jog  # noqa: PLC0415
    from norton_bench.jog.hands import DEAD_MAN_S  # noqa: PLC0415
    from norton_bench.screen.experiment import Opening  # noqa: PLC0415

    require_terminal(
        'jog without values needs a terminal; norton-bench jog RIG --actuator 0.02 --duration "2 s" needs none'
    )
    runs = out or RUNS
    by_hand = Jog(speed_rad_s, DEAD_MAN_S if dead_man_s is None else dead_man_s)
    opening = Opening(
        lambda name: run_folder(None, name, runs), rig_file, backend=backend, seed=seed, runs=runs, jog=by_hand
    )
    show(opening, opening.by_hand(rig))
    return ExitCode.OK
