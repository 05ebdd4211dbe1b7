"""``rig check`` and ``devices``: the state of the bench before anything moves."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from norton_bench.cli.arguments import Backend, Json, RigFile, Seed
from norton_bench.cli.output import Output, plain_table
from norton_bench.errors import ExitCode, ExperimentError, UsageError, exit_code_of
from norton_bench.loop.stop_word import operator_stop

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from norton_bench.check.survey import BusCheck, DeviceCheck, HostCheck, LineCheck, RigCheck, Sender
    from norton_bench.rig.rig import Rig
    from norton_drivers.discovery import FoundPort


def check_data(result: "RigCheck") -> dict[str, Any]:
    """The results of ``rig check`` as ``--json`` prints them."""
    return {
        "devices": [_device_data(each) for each in result.devices],
        "buses": [_bus_data(each) for each in result.buses],
        "lines": [_line_data(each) for each in result.lines],
        "host": None if result.host is None else _host_data(result.host),
        "moved": list(result.moved),
        "problems": [str(problem) for problem in result.problems()],
        "remarks": list(result.remarks),
    }


def check_view(result: "RigCheck") -> Iterator["RenderableType"]:
    """The same for a terminal: each device with its streams, then the buses, this computer, and notes."""
    for device in result.devices:
        yield _device_line(device)
        yield _stream_table(device)
    for bus in result.buses:
        yield _bus_line(bus)
        # A kind of device for several drivers is one line.
        yield from dict.fromkeys(f"  {_sender_line(sender)}" for sender in bus.senders)
    yield from map(_line_line, result.lines)
    if result.host is not None:
        yield _host_line(result.host)
    yield from result.moved
    yield from (f"note: {remark}" for remark in result.remarks)


def _device_line(each: "DeviceCheck") -> str:
    if each.identity is None:
        return f"{each.role}: {each.driver}, no answer"
    details = {"": each.identity.address, "hardware ": each.identity.hardware, "firmware ": each.identity.firmware}
    if each.answer_s is not None:
        details["answers in "] = f"{each.answer_s * 1e3:.2f} ms"
    return ", ".join([f"{each.role}: {each.driver}", *(name + value for name, value in details.items() if value)])


def _stream_table(each: "DeviceCheck") -> "Table":
    table = _table(("  stream",), ("rate", "jitter", "age", "longest gap"))
    for stream in each.streams:
        if stream.readings:
            times = (f"{time_s * 1e3:.2f} ms" for time_s in (stream.jitter_s, stream.age_s, stream.longest_gap_s))
            table.add_row(f"  {stream.name}", f"{stream.rate_hz:.0f} Hz", *times)
        else:
            table.add_row(f"  {stream.name}", "none")
    return table


def _bus_line(each: "BusCheck") -> str:
    busy = f"{each.rate_hz:.0f} frames/s, {each.load:.0%} of the bitrate"
    strangers = f", unknown: {', '.join(each.strangers)}" if each.strangers else ""
    return f"bus {each.name}: {each.interface} on {each.channel}, {busy}{strangers}"


def _sender_line(each: "Sender") -> str:
    from norton_bench.check.buses import in_words  # noqa: PLC0415

    who = f"[{each.role}]" if each.role is not None else "not of this rig"
    address = f" at {in_words(each.options)}" if each.options else ""
    return f"{each.device}{address}, {who}: {', '.join(each.says)}"


def _line_line(each: "LineCheck") -> str:
    carries = "USB" if each.baud == 0 else f"{each.baud} baud"
    answers = "" if each.answer_s is None else f", answers in {each.answer_s * 1e3:.2f} ms"
    return (
        f"port {each.port}: {carries}, {each.share_there:.0%} there and {each.share_back:.0%} back at the rig's rate, "
        f"carries {each.greatest_rate_hz:.0f} readings/s{answers}"
    )


def _host_line(each: "HostCheck") -> str:
    late = ", ".join(
        f"{seconds * 1e3:.2f} ms {name}"
        for seconds, name in (
            (each.late_median_s, "at the median"),
            (each.late_99_s, "at 99 %"),
            (each.late_most_s, "at most"),
        )
    )
    return f"this computer: {'real time' if each.real_time else 'no real time'}, wakes up late by {late}"


def _device_data(each: "DeviceCheck") -> dict[str, Any]:
    identity, status = each.identity, each.status
    return {
        "role": each.role,
        "driver": each.driver,
        "address": identity.address if identity else None,
        "hardware": identity.hardware if identity else None,
        "firmware": identity.firmware if identity else None,
        "state": status.state.value if status else None,
        "answer_s": each.answer_s,
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


def _bus_data(each: "BusCheck") -> dict[str, Any]:
    return {
        "name": each.name,
        "interface": each.interface,
        "channel": each.channel,
        "frames": each.frames,
        "rate_hz": each.rate_hz,
        "load": each.load,
        "senders": [
            {
                "driver": sender.driver,
                "device": sender.device,
                "options": dict(sender.options),
                "says": list(sender.says),
                "frames": sender.frames,
                "role": sender.role,
            }
            for sender in each.senders
        ],
        "unknown": list(each.strangers),
        "troubles": dict(each.troubles),
        "problems": [str(problem) for problem in each.problems],
    }


def _line_data(each: "LineCheck") -> dict[str, Any]:
    return {
        "role": each.role,
        "port": each.port,
        "baud": each.baud or None,
        "share_there": each.share_there,
        "share_back": each.share_back,
        "greatest_rate_hz": each.greatest_rate_hz,
        "answer_s": each.answer_s,
    }


def _host_data(each: "HostCheck") -> dict[str, Any]:
    return {
        "real_time": each.real_time,
        "late_median_s": each.late_median_s,
        "late_99_s": each.late_99_s,
        "late_most_s": each.late_most_s,
    }


def _table(texts: Sequence[str], numbers: Sequence[str]) -> "Table":
    table = plain_table()
    for heading in texts:
        table.add_column(heading, no_wrap=True)
    for heading in numbers:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


Move = Annotated[bool, Parameter(help="Also push the shaft gently, and compare what the devices measure.")]


def check(
    rig_file: RigFile, /, *, move: Move = False, backend: Backend = None, seed: Seed = None, json: Json = False
) -> int:
    """Open every device of a rig, listen for one second, and report what is wrong. Moves nothing without --move."""
    from norton_bench.check.check import Permission, check_rig  # noqa: PLC0415
    from norton_bench.rig.load import load_rig  # noqa: PLC0415

    output = Output(json)
    rig = load_rig(rig_file, backend=backend)
    if move:
        with operator_stop() as stop_word:
            result = check_rig(rig, seed=seed, move=Permission(output.say, stop_word.heard))
    else:
        result = check_rig(rig, seed=seed)
    suits, refusal = standard_session_suits(rig, result)
    output.result({**check_data(result), "identify": refusal}, *check_view(result), suits)
    return say_problems(rig_file, result, output)


def say_problems(rig_file: Path, result: "RigCheck", output: Output) -> int:
    """Print each problem in a line; returns the exit code."""
    problems = result.problems()
    for problem in problems:
        output.say(f"{rig_file}: {problem}")
    return exit_code_of(problems[0]) if problems else ExitCode.OK


def standard_session_suits(rig: "Rig", found: "RigCheck") -> tuple[str, str | None]:
    """Whether ``identify`` can run on this rig, in a sentence; and the reason why it is refused, if it is.

    A rig may be made for other sessions, so that this is reported as a note and not as a problem.
    """
    from norton_bench.check.check import raise_overfull  # noqa: PLC0415
    from norton_bench.cli.plan import clock  # noqa: PLC0415
    from norton_bench.session.dry_run import dry_run  # noqa: PLC0415
    from norton_bench.session.schema import standard_session  # noqa: PLC0415
    from norton_drivers.errors import WiringError  # noqa: PLC0415

    session = standard_session(rig)
    try:
        plan = dry_run(session, rig)
        raise_overfull(found.overfull())
    except (UsageError, WiringError, ExperimentError) as error:
        return f"norton-bench identify would refuse this rig: {error}", str(error)
    steps = ", ".join(dict.fromkeys(step.planned.name for step in plan.steps))
    once = " once what was found is mended" if found.problems() else ""
    return f"norton-bench identify can run on it{once}: {steps}; {clock(plan.at_most_s)} of bench time", None


def devices(*, json: Json = False) -> None:
    """List the serial ports and CAN adapters of this machine, as a rig file names them. Opens nothing."""
    from norton_drivers.discovery import list_ports  # noqa: PLC0415

    ports = list_ports()
    data = {"ports": [_port_data(each) for each in ports]}
    none = "Neither a serial port nor a CAN adapter was found; is it plugged in, and is its driver loaded?"
    Output(json).result(data, *(port_lines(ports) if ports else (none,)))


def port_lines(ports: Sequence["FoundPort"]) -> Iterator[str]:
    """For each port the lines of a rig file, a description, and what to do where it cannot be used."""
    for each in ports:
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
