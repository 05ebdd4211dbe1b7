"""A whole session of one family of drives through a CAN link of the kernel, compared with what is true."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

from guest import Tell
from program import bench, bench_here, rig_on, served, shipped_rig

SEED = 41
# The 95 % are not judged by one session. At this rate the intervals of what is faster than a tick (bandwidth of the
# amplifier, damping of presliding) are too narrow: values were off by up to 1.7 of them in lock step, too.
WITHIN = 3.0


def write_truth(checkout: Path, family: str, folder: Path) -> None:
    """On the host, whose time is cheaper."""
    _, truth = bench_here("sim", "truth", shipped_rig(checkout, family), "--seed", SEED, "--json")
    truth_of(family, folder).write_text(truth, encoding="utf-8")


def truth_of(family: str, folder: Path) -> Path:
    return folder / f"{family}-truth.json"


def run(checkout: Path, family: str, tell: Tell) -> None:
    os.environ["PYTHONPATH"] = str(checkout / "tests/socketcan/every_process")
    for command in ("ip link add vcan0 type vcan", "ip link set vcan0 up"):
        subprocess.run(command.split(), check=True)
    rig, out = rig_on(checkout, family, "vcan0"), checkout / "runs/socketcan" / family
    session = checkout / "tests/socketcan/session.toml"
    with served(rig, SEED):
        code, said = bench("run", session, "--rig", rig, "--backend", "hardware", "--out", out, "--json")
    result = json.loads(said) if said.startswith("{") else {}
    if not result.get("network"):
        tell(f"{family}: session", False, f"exit code {code}: {last_line(said)}")
        return
    network = json.loads(Path(result["network"]).read_text(encoding="utf-8"))
    tell(f"{family}: session, to a network file of {len(network['parameters'])} values", True, f"exit code {code}")
    for name, true in json.loads(truth_of(family, out.parent).read_text(encoding="utf-8"))["parameters"].items():
        _compare(f"{family}: {name}", result["parameters"].get(name), true, tell)


def _compare(what: str, found: dict[str, Any] | None, true: dict[str, Any], tell: Tell) -> None:
    if found is None or found["status"] != "valid":
        tell(what, True, "not told" if found is None else str(found["status"]))
        return
    interval, off = 2 * found["std"], abs(found["value"] - true["value"])
    value = f"{found['value']:.4g} \u00b1 {interval:.2g} {found['unit']}"
    seen = f"{value}, true {true['value']:.4g}: off by {off / interval:.1f} intervals"
    tell(what, off <= WITHIN * interval, seen)


def last_line(text: str) -> str:
    return next((line for line in reversed(text.splitlines()) if line.strip()), "nothing")
