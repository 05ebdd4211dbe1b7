"""Which rig gets which checks, and that the rig file can name each of them."""

from dataclasses import replace
from math import inf

import pytest

from norton_bench.guard.guard import Equipment, checks_for
from norton_bench.rig.rig import Command, Limits
from norton_bench.rig.schema import PLAUSIBILITY

LIMITS = Limits(torque_nm=1.0, velocity_rad_s=80.0, stale_after_ns=5_000_000)
TORQUE = Command("N*m", 0.5)
DYNO = Equipment(load=True, torque_sensor=True, runs=True, range_nm=2.0, resolution_rad=5e-5)
OF_LOAD = ["encoder", "encoder", "coupling"]
OF_SENSOR = ["frozen torque", "torque jump"]
OF_BOTH = ["balance", "standstill"]
POSITION = Command("rad", 0.4)


def names(fitted: Equipment, command: Command = TORQUE, leave_out: tuple[str, ...] = ()) -> list[str]:
    return [check.name for check in checks_for(LIMITS, command, 1e-3, fitted, leave_out)]


@pytest.mark.parametrize(
    ("fitted", "command", "expected"),
    [
        (DYNO, TORQUE, [*OF_LOAD, "current", "current", *OF_SENSOR, "saturation", *OF_BOTH]),
        (replace(DYNO, range_nm=inf), TORQUE, [*OF_LOAD, "current", "current", *OF_SENSOR, *OF_BOTH]),
        (replace(DYNO, range_nm=inf, resolution_rad=0.0), POSITION, [*OF_LOAD, "current", *OF_SENSOR, "balance"]),
        (DYNO, Command("1", 0.9), [*OF_LOAD, "current", *OF_SENSOR, "saturation", *OF_BOTH]),
        (replace(DYNO, torque_sensor=False, range_nm=inf), TORQUE, [*OF_LOAD, "current", "current"]),
        (Equipment(False, False, True), Command("mA", 500.0), ["encoder", "standstill", "current"]),
        (Equipment(False, False, False), TORQUE, ["encoder", "current"]),
        (Equipment(False, True, False, 2.0), TORQUE, ["encoder", "current", *OF_SENSOR, "saturation"]),
    ],
)
def test_a_rig_gets_the_checks_that_it_has_signals_for(
    fitted: Equipment, command: Command, expected: list[str]
) -> None:
    assert names(fitted, command) == expected


def test_what_is_left_out_is_not_there() -> None:
    assert names(DYNO, leave_out=("encoder", "balance")) == [
        "coupling",
        *("current", "current"),
        *OF_SENSOR,
        "saturation",
        "standstill",
    ]


@pytest.mark.parametrize("sent_as", ["N*m", "A", "mA"])
def test_a_drive_that_takes_a_torque_or_a_current_is_held_to_its_current_whatever_that_stands_for(sent_as: str) -> None:
    assert names(DYNO, replace(POSITION, sent_as=sent_as)) == names(DYNO)


def test_the_rig_file_knows_every_check_by_its_name() -> None:
    free = replace(DYNO, load=False)
    modulated = replace(DYNO, modulation=Command("N*m/rad", 4.0))
    assert set(names(modulated)) | set(names(free)) == set(PLAUSIBILITY)
