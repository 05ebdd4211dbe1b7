"""The unit of a drive's commands: told where the rig file is read, by its key and with the mend."""

from pathlib import Path

import pytest

from norton_bench.errors import RigError
from norton_bench.rig.driver_options import amplifier_options, in_words, options_for
from norton_bench.rig.load import parse_rig
from norton_drivers import registry

VESC = (Path(__file__).parents[3] / "rigs" / "sim-vesc.toml").read_text()
ODRIVE_LOAD = (
    'driver = "odrive"\nbus = "can0"\nnode = 2\nfirmware = "0.6"\nwatchdog = "300 ms"\ncounts_per_turn = 131072\n'
)
VESC_LOAD = 'driver = "vesc"\nbus = "can0"\nnode = 2\npole_pairs = 7\n'
ACTUATORS_MODE = 'mode = "current"                    # or "torque", with torque_constant = "0.05 N*m/A", or "duty"'


def refusals(text: str) -> list[str]:
    with pytest.raises(RigError) as refusal:
        parse_rig(text, place="r.toml")
    return str(refusal.value).splitlines()


def test_a_load_that_takes_amperes() -> None:
    assert ODRIVE_LOAD in VESC
    (sentence,) = refusals(VESC.replace(ODRIVE_LOAD, VESC_LOAD))
    assert sentence == (
        'r.toml: [load] mode: driver = "vesc" as it is set here takes commands in "A", but a load is commanded in '
        'newton metres; write mode = "torque" and torque_constant = "0.05 N*m/A"'
    )
    (sentence,) = refusals(VESC.replace(ODRIVE_LOAD, VESC_LOAD + 'mode = "torque"\n'))
    assert "[load] torque_constant: " in sentence
    mended = VESC_LOAD + 'mode = "torque"\ntorque_constant = "0.05 N*m/A"\n'
    assert parse_rig(VESC.replace(ODRIVE_LOAD, mended), place="r.toml").wiring.load is not None


def test_an_actuators_command_in_another_unit_than_its_mode() -> None:
    (sentence,) = refusals(VESC.replace('unit = "A", limit = "9 A"', 'unit = "N*m", limit = "0.4 N*m"'))
    assert sentence == (
        'r.toml: [actuator.command] unit: "N*m", but driver = "vesc" as it is set here takes commands in "A"; write '
        'unit = "A", or mode = "torque" and torque_constant = "0.05 N*m/A" in [actuator]'
    )
    (sentence,) = refusals(VESC.replace(ACTUATORS_MODE, 'mode = "duty"'))
    assert '[actuator.command] unit: "A", but ' in sentence
    assert 'write unit = "1", or mode = "current" in [actuator]' in sentence


def test_a_number_that_stands_for_something_else_is_sent_in_the_drives_unit() -> None:
    valve = 'unit = "V", limit = "9 V", sent_as = "A"'
    assert parse_rig(VESC.replace('unit = "A", limit = "9 A"', valve), place="r.toml").command.unit == "V"
    (sentence,) = refusals(VESC.replace('unit = "A", limit = "9 A"', valve.replace('"A"', '"N*m"')))
    assert '[actuator.command] sent_as: "N*m", but ' in sentence


def test_what_no_option_mends_is_not_promised() -> None:
    text = VESC.replace('driver = "vesc"', 'driver = "odrive"', 1).replace("pole_pairs = 7\n", "")
    text = text.replace(ACTUATORS_MODE, "").replace('position = "encoder"', 'position = "turns"')
    text = "\n".join(line for line in text.splitlines() if not line.startswith(("minimum_current", "watchdog_probe")))
    (sentence,) = refusals(text)
    assert sentence.endswith('takes commands in "N*m"; write unit = "N*m"')


@pytest.mark.parametrize("driver", registry.names(registry.AMPLIFIERS))
def test_every_shipped_drive_can_be_a_load(driver: str) -> None:
    """And says so before it is open."""
    needed = {
        "odrive": {"node": 1},
        "mit": {"node": 1, "position_range": 12.5, "velocity_range": 50.0, "torque_range": 2.0},
        "cia402": {"node": 1, "torque_per_unit": 1e-3, "counts_per_turn": 4096, "velocity_per_unit": 0.1},
        "odrive_uart": {},
        "simplefoc": {"mode": "torque", "torque_constant": 0.05, "current_limit": 9.0},
        "moteus": {"node": 1},
        "vesc": {"node": 1, "pole_pairs": 7, "mode": "torque", "torque_constant": 0.05},
        "vesc_uart": {"pole_pairs": 7, "mode": "torque", "torque_constant": 0.05},
        "damiao": {"node": 1, "master": 17},
        "robstride": {"node": 1, "motor": "rs02"},
        "cubemars": {"node": 1, "pole_pairs": 21, "gear_ratio": 9, "mode": "torque", "torque_constant": 0.8},
        "dynamixel": {"node": 1, "type": "XM430-W350", "mode": "torque", "torque_constant": 1.8},
        "feetech": {"node": 1, "type": "STS3215", "mode": "torque", "stall_torque": 1.9},
    }[driver]
    options = amplifier_options(driver, needed)
    assert options is not None
    assert options.command_unit == "N*m"


def test_the_mend_names_what_only_the_user_knows() -> None:
    settings = options_for("vesc", {"node": 1, "pole_pairs": 7}, "N*m")
    assert in_words(settings) == 'mode = "torque" and torque_constant = "0.05 N*m/A"'
    given = {"node": 1, "pole_pairs": 7, "torque_constant": 0.05}
    assert in_words(options_for("vesc", given, "N*m")) == 'mode = "torque"'
    assert (options_for("vesc", given, "V"), options_for("nobodys", given, "A")) == ({}, {})
