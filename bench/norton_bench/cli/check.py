"""``rig check`` and ``devices``: what is there, before anything moves."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import Backend, Json, RigFile, Seed
from norton_bench.cli.found import check_data, check_view
from norton_bench.cli.interrupt import operator_stop
from norton_bench.cli.output import Output
from norton_bench.errors import ExitCode
from norton_bench.session.failure import exit_code_of

if TYPE_CHECKING:
    from norton_bench.check.findings import RigCheck
    from norton_bench.rig.rig import Rig
    from norton_drivers.discovery import FoundPort


Move = Annotated[bool, Parameter(help="Also push the shaft gently, and see whether all devices tell of it alike.")]


def check(
    rig_file: RigFile, /, *, move: Move = False, backend: Backend = None, seed: Seed = None, json: Json = False
) -> int:
    """Open every device of a rig, watch it for a second, and say what is wrong. Moves nothing without --move."""
    from norton_bench.check.check import Permission, check_rig  # noqa: PLC0415
    from norton_bench.rig.load import load_rig  # noqa: PLC0415

    output = Output(json)
    rig = load_rig(rig_file, backend=backend)
    if move:
        with operator_stop() as stop_word:
            found = check_rig(rig, seed=seed, move=Permission(output.say, stop_word.heard))
    else:
        found = check_rig(rig, seed=seed)
    suits, refusal = standard_session_suits(rig)
    output.result({**check_data(found), "identify": refusal}, *check_view(found), suits)
    return say_problems(rig_file, found, output)


def say_problems(rig_file: Path, found: "RigCheck", output: Output) -> int:
    """Each in a line; returns the exit code."""
    problems = found.problems()
    for problem in problems:
        output.say(f"{rig_file}: {problem}")
    return exit_code_of(problems[0]) if problems else ExitCode.OK


def standard_session_suits(rig: "Rig") -> tuple[str, str | None]:
    """Whether ``identify`` would take this rig, in a sentence; and what it would refuse it for, if it would.

    A rig may well be for other sessions: what keeps the standard one from running is told, and is no problem of the
    bench.
    """
    from norton_bench.cli.plan import clock  # noqa: PLC0415
    from norton_bench.errors import UsageError  # noqa: PLC0415
    from norton_bench.session.dry_run import dry_run  # noqa: PLC0415
    from norton_bench.session.schema import standard_session  # noqa: PLC0415
    from norton_drivers.errors import WiringError  # noqa: PLC0415

    session = standard_session(rig)
    try:
        plan = dry_run(session, rig)
    except (UsageError, WiringError) as error:
        return f"norton-bench identify would refuse this rig: {error}", str(error)
    steps = ", ".join(dict.fromkeys(step.planned.name for step in plan.steps))
    return f"norton-bench identify can run on it: {steps}; {clock(plan.at_most_s)} of bench time", None


def devices(*, json: Json = False) -> None:
    """List what a rig file could name: serial ports and CAN adapters that are plugged in. Opens nothing."""
    from norton_drivers.discovery import list_ports  # noqa: PLC0415

    found = list_ports()
    data = {"ports": [_port_data(each) for each in found]}
    none = "Neither a serial port nor a CAN adapter was found; is it plugged in, and is its driver loaded?"
    Output(json).result(data, *(port_lines(found) if found else (none,)))


def port_lines(found: Sequence["FoundPort"]) -> Iterator[str]:
    """Each port in lines that can be copied from: what a rig file would say, what it is, what to do about it."""
    for each in found:
        maybe = f" (or {each.interface})" if each.interface else ""
        yield f"{each.kind}{maybe} {each.channel}"
        usb = f" ({each.usb})" if each.usb else ""
        also = f", {each.device}" if each.device not in ("", each.channel) else ""
        if each.description or usb or also:
            yield f"  {each.description}{usb}{also}"
        if each.mend:
            yield f"  {each.mend}"


def _port_data(each: "FoundPort") -> dict[str, Any]:
    return {
        "kind": each.kind,
        "channel": each.channel,
        "description": each.description,
        "device": each.device or None,
        "usb": each.usb or None,
        "interface": each.interface or None,
        "mend": each.mend or None,
    }
