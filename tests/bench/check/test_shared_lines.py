"""Servos that share a line, mis-set in every way that the bench should notice: each told with the mend."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from norton_bench.check.check import check_rig
from norton_bench.rig.load import load_rig

RIGS = Path(__file__).parents[3] / "rigs"
DYNAMIXEL = "[actuator] dynamixel on socket://localhost:7711: nothing answers as the rig file says, but at "
FEETECH = "[actuator] feetech on socket://localhost:7714: nothing answers as the rig file says, but at "


def sentences(name: str, **device: Any) -> list[str]:
    """What is said of a rig whose actuator is really set up otherwise."""
    rig = load_rig(RIGS / f"{name}.toml")
    table = {**rig.simulated["actuator"], "device": device}
    otherwise = replace(rig, simulated={**rig.simulated, "actuator": table})
    return [str(problem).split(".toml: ")[-1] for problem in check_rig(otherwise, seed=1, watch_s=0.2).problems()]


@pytest.mark.parametrize("name", ["sim-dynamixel", "sim-dynamixel-alone", "sim-feetech"])
def test_a_bench_in_order(name: str) -> None:
    assert sentences(name) == []


@pytest.mark.parametrize(
    ("name", "device", "sentence"),
    [
        (
            "sim-dynamixel",
            {"node": 7},
            DYNAMIXEL + "4000000 baud there is a Dynamixel (XM430-W210); set node = 7",
        ),
        (
            "sim-dynamixel",
            {"baud": 57600},
            DYNAMIXEL + "57600 baud there is a Dynamixel (XM430-W210); set baud = 57600",
        ),
        (
            "sim-dynamixel",
            {"driver": "feetech", "type": "STS3215", "node": 3, "baud": 4_000_000},
            DYNAMIXEL + '4000000 baud there is a Feetech servo (STS3215); set driver = "feetech", node = 3, '
            'type = "STS3215"',
        ),
        (
            "sim-feetech",
            {"node": 9},
            FEETECH + "1000000 baud there is a Feetech servo (STS3215); set node = 9",
        ),
        (
            "sim-feetech",
            {"type": "STS3250"},
            "[actuator] Feetech servo 1 on socket://localhost:7714: is STS3250, not the STS3215 of the rig file, which "
            "would read its numbers wrongly; correct type",
        ),
    ],
)
def test_who_is_there_instead(name: str, device: dict[str, Any], sentence: str) -> None:
    assert sentences(name, **device) == [sentence]
