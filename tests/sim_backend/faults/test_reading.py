"""Faults as they are written: read with their units, and refused with a sentence for each mistake."""

import tomllib
from dataclasses import replace
from math import inf, isnan

import pytest

from norton_drivers.errors import WiringError
from norton_drivers.wiring import Wiring
from norton_sim.faults.injection import COUNTED_EFFECTS, EFFECTS, read_faults
from norton_sim.faults.schema import KINDS, Delay, FalseReading, Fault, HostStall


def read(text: str, wiring: Wiring) -> tuple[Fault, ...]:
    return read_faults(tomllib.loads(text)["fault"], wiring, place="rig.toml", section="simulated.fault")


def complaint(text: str, wiring: Wiring) -> str:
    with pytest.raises(WiringError) as caught:
        read(text, wiring)
    return str(caught.value)


def test_quantities_become_si_and_what_is_not_written_takes_its_default(wiring: Wiring) -> None:
    text = '[[fault]]\nkind = "delay"\non = "can0"\nat = "2 s"\nfor = "100 ms"\nby = "20 ms"\nshare = "50 %"\n'
    (fault,) = read(text, wiring)
    assert fault == Delay(on="can0", at_s=2.0, lasts_s=0.1, by_s=0.02, share=0.5)
    assert (fault.after, fault.towards, fault.count) == ("start", "both", None)
    (for_ever,) = read('[[fault]]\nkind = "drop"\non = "load"\n', wiring)
    assert (for_ever.at_s, for_ever.duration_s) == (0.0, inf)


def test_no_number_is_a_reading_too(wiring: Wiring) -> None:
    (fault,) = read('[[fault]]\nkind = "false-reading"\non = "torque_sensor"\ntorque = "nan"\n', wiring)
    assert isinstance(fault, FalseReading)
    assert isnan(fault.torque_nm)


def test_every_kind_has_an_effect_and_no_effect_is_without_a_kind() -> None:
    assert set(KINDS.values()) == EFFECTS.keys() | COUNTED_EFFECTS.keys()
    assert not EFFECTS.keys() & COUNTED_EFFECTS.keys()
    assert all(name == kind.kind for name, kind in KINDS.items())


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ('kind = "dely"', '[simulated.fault 1] kind = "dely" is no fault; did you mean "delay"?'),
        ('on = "can0"', '[simulated.fault 1] kind is missing; add kind = "drop" (or delay, '),
        ('kind = "drop"', '[simulated.fault 1, drop] on is missing; add on = "actuator"'),
        (
            'kind = "drop"\non = "can0"\nby = "1 s"',
            "[simulated.fault 1, drop] by is not known; known here: at, after, on",
        ),
        (
            'kind = "drop"\non = "can0"\nlasts_s = "1 s"',
            "[simulated.fault 1, drop] lasts_s is not known; known here: at",
        ),
        ('kind = "drop"\non = "can0"\nat = 2', '[simulated.fault 1, drop] at: "2" has no unit; write it like "1 s"'),
        ('kind = "drop"\non = "can0"\nfor = "1 V"', '[simulated.fault 1, drop] for: "1 V" is not in s'),
        (
            'kind = "drop"\non = "can0"\ncount = 0',
            "[simulated.fault 1, drop] count = 0 should be greater than or equal",
        ),
        ('kind = "drop"\non = "can0"\nafter = "noon"', "after = 'noon' should be 'start' or 'armed'"),
        (
            'kind = "drop"\non = "can7"',
            '"can7" is no place for drop; on this bench: actuator, load, torque_sensor, can0',
        ),
        ('kind = "delay"\non = "can0"', '[simulated.fault 1, delay] by is missing; add by = "20 ms"'),
        (
            'kind = "stuck"\non = "torque_sensor"',
            '"torque_sensor" is no place for stuck; on this bench: actuator, load',
        ),
        ('kind = "saturation"\non = "load"\nlimit = "1 N*m"', '"load" is no place for saturation'),
        ('kind = "unplugged"\non = "load"', "[load] has no adapter of its own; name its bus, or use dropout"),
        ('kind = "bus-off"\non = "torque_sensor"', "[torque_sensor] is on a serial line, which knows no bus-off"),
        ('kind = "reorder"\non = "torque_sensor"', "nothing overtakes on the serial line of [torque_sensor]"),
        (
            'kind = "corrupt"\non = "torque_sensor"\ncrc = "caught"',
            "crc: the serial line of [torque_sensor] has no check",
        ),
        ('kind = "host-stall"', '[simulated.fault 1, host-stall] for is missing; add for = "150 ms"'),
        ('kind = "unplugged"\non = "can0"\nfor = "1 s"', "[simulated.fault 1, unplugged] for is not known"),
    ],
)
def test_a_mistake_is_told_in_one_sentence_with_place_and_mend(wiring: Wiring, table: str, sentence: str) -> None:
    said = complaint(f"[[fault]]\n{table}\n", wiring)
    assert said.startswith("rig.toml: [simulated.fault 1")
    assert sentence in said
    assert "\n" not in said


def test_all_mistakes_are_told_at_once(wiring: Wiring) -> None:
    said = complaint('[[fault]]\nkind = "drop"\n[[fault]]\nkind = "stuck"\non = "load"\nat = "-1 s"\nfor = 3\n', wiring)
    assert [line.split("]")[0] for line in said.splitlines()] == [
        "rig.toml: [simulated.fault 1, drop",
        "rig.toml: [simulated.fault 2, stuck",
        "rig.toml: [simulated.fault 2, stuck",
    ]


@pytest.mark.parametrize("text", ['[fault]\nkind = "drop"', "fault = 3", "fault = 'drop'", "fault = [3]"])
def test_what_is_no_list_of_tables_is_refused(wiring: Wiring, text: str) -> None:
    assert "should be a" in complaint(text, wiring)


def test_a_coupling_can_only_break_where_there_is_one(wiring: Wiring) -> None:
    text = '[[fault]]\nkind = "broken-coupling"\n'
    assert len(read(text, wiring)) == 1
    assert "nothing is coupled to the actuator" in complaint(text, replace(wiring, load=None))


def test_from_python_numbers_are_si(wiring: Wiring) -> None:
    assert HostStall(lasts_s=0.15) == read('[[fault]]\nkind = "host-stall"\nfor = "150 ms"\n', wiring)[0]
    with pytest.raises(ValueError, match="greater than 0"):
        HostStall(lasts_s=-1.0)
