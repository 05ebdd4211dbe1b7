"""``rig check`` and ``devices``: what is there, before anything moves."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import Backend, Json, RigFile, Seed
from norton_bench.cli.found import check_data, check_view
from norton_bench.cli.interrupt import operator_stop
from norton_bench.cli.output import Output
from norton_bench.errors import ExitCode
from norton_bench.session.failure import exit_code_of

if TYPE_CHECKING:
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
    output.result(check_data(found), *check_view(found))
    problems = found.problems()
    for problem in problems:
        output.say(f"{rig_file}: {problem}")
    return exit_code_of(problems[0]) if problems else ExitCode.OK


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
