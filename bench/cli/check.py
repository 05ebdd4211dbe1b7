"""``rig check`` and ``devices``: what is there, before anything moves."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from bench.cli.arguments import Backend, Json, RigFile, Seed
from bench.cli.exits import exit_code_of
from bench.cli.output import Output
from bench.errors import ExitCode

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table

    from bench.rig.check import DeviceCheck
    from drivers.discovery import FoundPort


def check(rig_file: RigFile, /, *, backend: Backend = None, seed: Seed = None, json: Json = False) -> int:
    """Open every device of a rig, watch it for a second, and say what is wrong. Moves nothing."""
    from bench.rig.check import check_rig  # noqa: PLC0415
    from bench.rig.load import load_rig  # noqa: PLC0415

    checks = check_rig(load_rig(rig_file, backend=backend), seed=seed)
    output = Output(json)
    output.result(check_data(checks), check_view(checks))
    problems = [problem for each in checks for problem in each.problems]
    for problem in problems:
        output.say(f"{rig_file}: {problem}")
    return exit_code_of(problems[0]) if problems else ExitCode.OK


def devices(*, json: Json = False) -> None:
    """List what a rig file could name: serial ports and CAN adapters that are plugged in. Opens nothing."""
    from drivers.discovery import list_ports  # noqa: PLC0415

    found = list_ports()
    data = {"ports": [{"kind": each.kind, "channel": each.channel, "description": each.description} for each in found]}
    none = "Neither a serial port nor a CAN adapter was found; is it plugged in, and is its driver loaded?"
    Output(json).result(data, port_table(found) if found else none)


def check_data(checks: Sequence["DeviceCheck"]) -> dict[str, Any]:
    """What ``--json`` prints."""
    return {"devices": [_device_data(each) for each in checks]}


def check_view(checks: Sequence["DeviceCheck"]) -> "Group":
    """Each device in a line, and below it its streams, one a row."""
    from rich.console import Group  # noqa: PLC0415

    return Group(*(part for each in checks for part in (_device_line(each), _stream_table(each))))


def port_table(found: Sequence["FoundPort"]) -> "Table":
    """Kind, channel and description, a row each."""
    table = _table(("kind", "channel", "description"))
    for each in found:
        table.add_row(each.kind, each.channel, each.description)
    return table


def _device_line(each: "DeviceCheck") -> str:
    if each.identity is None:
        return f"{each.role}: {each.driver}, not heard"
    said = {"": each.identity.address, "hardware ": each.identity.hardware, "firmware ": each.identity.firmware}
    return ", ".join([f"{each.role}: {each.driver}", *(name + value for name, value in said.items() if value)])


def _stream_table(each: "DeviceCheck") -> "Table":
    table = _table(("  stream",), ("rate", "jitter", "age", "longest gap"))
    for stream in each.streams:
        if stream.readings:
            times = (f"{time_s * 1e3:.2f} ms" for time_s in (stream.jitter_s, stream.age_s, stream.longest_gap_s))
            table.add_row(f"  {stream.name}", f"{stream.rate_hz:.0f} Hz", *times)
        else:
            table.add_row(f"  {stream.name}", "none")
    return table


def _device_data(each: "DeviceCheck") -> dict[str, Any]:
    identity, status = each.identity, each.status
    return {
        "role": each.role,
        "driver": each.driver,
        "address": identity.address if identity else None,
        "hardware": identity.hardware if identity else None,
        "firmware": identity.firmware if identity else None,
        "state": status.state.value if status else None,
        "streams": {
            stream.name: {
                "readings": stream.readings,
                "rate_hz": stream.rate_hz,
                "jitter_s": stream.jitter_s,
                "age_s": stream.age_s,
                "longest_gap_s": stream.longest_gap_s,
            }
            for stream in each.streams
        },
        "problems": [str(problem) for problem in each.problems],
    }


def _table(texts: Sequence[str], numbers: Sequence[str] = ()) -> "Table":
    from rich.table import Table  # noqa: PLC0415

    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in texts:
        table.add_column(heading, no_wrap=True)
    for heading in numbers:
        table.add_column(heading, justify="right", no_wrap=True)
    return table
