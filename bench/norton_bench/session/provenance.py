"""What goes into the recording, the network file and the report beside the data: rig, session, devices, versions."""

import json
import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version

from norton_bench.rig.files import toml
from norton_bench.rig.rig import Rig
from norton_bench.session.schema import Session
from norton_drivers.readings import DeviceIdentity

PACKAGES = ("norton-bench", "numpy", "scipy", "numba", "filterpy", "python-can", "pyserial")


def provenance(rig: Rig, session: Session, seed: int | None, devices: Iterable[DeviceIdentity]) -> Mapping[str, str]:
    """By name, as texts. ``seed`` is that of a simulation."""
    return {
        "rig": rig.name,
        "rig_file": rig.place,
        "backend": rig.backend,
        "session": session.place,
        "arguments": session.arguments,
        "parameters": ", ".join(f"{name} = {toml(value)}" for name, value in session.parameters.items()),
        "seed": "" if seed is None else str(seed),
        "command_unit": rig.command.unit,
        "modulation_unit": "" if rig.modulation is None else rig.modulation.unit,
        "model": rig.model,
        "tick_s": repr(rig.tick_s),
        "torque_averaging_s": repr(rig.chain.torque_averaging_s),
        "released_at_zero": " ".join(sorted(rig.chain.released_at_zero)),
        "answers_commands": " ".join(sorted(rig.chain.answers_commands)),
        **({} if rig.servo is None else {"servo": json.dumps(asdict(rig.servo))}),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "devices": "; ".join(device.words for device in devices),
        "python": platform.python_version(),
        "system": platform.platform(),
        **{name: version(name) for name in PACKAGES},
    }
