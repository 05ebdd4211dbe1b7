"""What ``rig check`` found, for programs and for people."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from norton_bench.cli.output import plain_table

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from norton_bench.check.findings import BusCheck, DeviceCheck, HostCheck, RigCheck, Sender


def check_data(found: "RigCheck") -> dict[str, Any]:
    """What ``--json`` prints."""
    return {
        "devices": [_device_data(each) for each in found.devices],
        "buses": [_bus_data(each) for each in found.buses],
        "host": None if found.host is None else _host_data(found.host),
        "moved": list(found.moved),
        "problems": [str(problem) for problem in found.problems()],
        "remarks": list(found.remarks),
    }


def check_view(found: "RigCheck") -> Iterator["RenderableType"]:
    """Each device in a line, below it its streams, one a row; then the buses, the host, and what is worth knowing."""
    for device in found.devices:
        yield _device_line(device)
        yield _stream_table(device)
    for bus in found.buses:
        yield _bus_line(bus)
        # A kind that several drivers speak to is one line.
        yield from dict.fromkeys(f"  {_sender_line(sender)}" for sender in bus.senders)
    if found.host is not None:
        yield _host_line(found.host)
    yield from found.moved
    yield from (f"note: {remark}" for remark in found.remarks)


def _device_line(each: "DeviceCheck") -> str:
    if each.identity is None:
        return f"{each.role}: {each.driver}, not heard"
    said = {"": each.identity.address, "hardware ": each.identity.hardware, "firmware ": each.identity.firmware}
    if each.answer_s is not None:
        said["answers in "] = f"{each.answer_s * 1e3:.2f} ms"
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


def _bus_line(each: "BusCheck") -> str:
    busy = f"{each.rate_hz:.0f} frames/s, {each.load:.0%} of the bitrate"
    strangers = f", unknown: {', '.join(each.strangers)}" if each.strangers else ""
    return f"bus {each.name}: {each.interface} on {each.channel}, {busy}{strangers}"


def _sender_line(each: "Sender") -> str:
    from norton_bench.check.buses import in_words  # noqa: PLC0415

    who = f"[{each.role}]" if each.role is not None else "not of this rig"
    address = f" at {in_words(each.options)}" if each.options else ""
    return f"{each.device}{address}, {who}: {', '.join(each.says)}"


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
