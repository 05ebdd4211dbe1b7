"""Column maps: what is wrong in one is said, all of it, with place and mend."""

import re
from pathlib import Path

import pytest

from norton_bench.errors import UsageError
from norton_bench.logs.column_map import (
    ActuatorSection,
    ColumnSection,
    ColumnsSection,
    FilterSection,
    Given,
    LoadSection,
    LogSection,
    LoopSection,
    ModelSection,
    SplitSection,
    load_map,
    parse_map,
)
from norton_bench.rig.files import keys_of
from tests.bench.logs.machines import FREE

ROOT = Path(__file__).parents[3]
RIGHT = """\
title = "a machine"
[log]
motion = "rotation"
[columns]
time = { name = "t", unit = "ms" }
position = "q"
command = { name = "u", unit = "V", scale = 2 }
"""


def mistakes_in(text: str) -> str:
    with pytest.raises(UsageError) as raised:
        parse_map(text, place="m.toml")
    return str(raised.value)


def test_a_bare_name_has_the_unit_that_the_log_gives() -> None:
    assert parse_map(RIGHT, place="m.toml").columns.position == ColumnSection(name="q", unit=None)
    said = mistakes_in(RIGHT.replace('"q"', '{ name = "q", unit = "" }'))
    assert said == 'm.toml: [columns.position] unit: "" cannot be given in rad; write rad or like it'


def test_a_right_map() -> None:
    found = parse_map(RIGHT.replace('"q"', '{ name = "q", unit = "deg" }'), place="m.toml")
    assert (found.units.gain, found.units.inertia, found.columns.command and found.columns.command.scale) == (
        "N*m/(V)",
        "kg*m^2",
        2.0,
    )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("title", "titel", 'titel: unknown key; did you mean "title"?'),
        ("[log]", "[lag]", 'lag: unknown key; did you mean "log"?'),
        ("scale = 2", "scal = 2", '[columns.command] scal: unknown key; did you mean "scale"?'),
        ('"rotation"', '"rotating"', '[log] motion: "rotating" is not allowed; write "rotation" or "translation"'),
        ('"ms"', '"parsec"', '[columns.time] unit: "parsec" is not a unit known here'),
        ('"ms"', '"m"', '[columns.time] unit: "m" cannot be given in s'),
        ("command =", "comand =", '[columns] comand: unknown key; did you mean "command"?'),
        ("scale = 2", "scale = true", "[columns.command] scale: expected a number, not true; write it like 0.001"),
        ("scale = 2", "sign = 2", "[columns.command] sign: 2 is not allowed; write 1 or -1"),
        ("position", "normal", "[columns] position: is missing"),
        ("command =", "goal =", "[columns]: neither command nor exertion is given"),
    ],
)
def test_mistakes_are_named_with_place_and_mend(old: str, new: str, said: str) -> None:
    right = RIGHT.replace('"q"', '{ name = "q", unit = "deg" }')
    assert old in right
    assert f"m.toml: {said}" in mistakes_in(right.replace(old, new, 1))


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ('[actuator]\ntorque_gain = "3 N/V"', '[actuator] torque_gain: "N/V" cannot be given in N*m/(V)'),
        ('[actuator]\ntorque_gain = "three"', '[actuator] torque_gain: "three" is not a quantity'),
        ('[load]\ngravity = { kye = "m" }', '[load.gravity] kye: unknown key; did you mean "key"?'),
        ('[loop]\nproportional = "3 V/rad"', "[loop]: needs a goal"),
        ('[filter]\ncutoff = "-3 Hz"', "[filter] cutoff"),
        ('[model]\nrefine = "motion"', "[model] refine: needs a known load"),
        ('[load]\ninertia = "1 kg*m^2"', "[load]: does not tell the size of any torque or force"),
        ("[model]\ntemperature = true", "[model] temperature: needs one; add [columns] temperature"),
        ('[columns.supply]\nname = "v"\nunit = "V"', "[columns] supply: is for a command that is a share of it"),
    ],
)
def test_mistakes_in_further_sections(section: str, said: str) -> None:
    right = RIGHT.replace('"q"', '{ name = "q", unit = "deg" }')
    assert f"m.toml: {said}" in mistakes_in(f"{right}{section}\n")


def test_a_slide_has_no_gravity_by_position() -> None:
    slide = RIGHT.replace("rotation", "translation").replace('"deg"', '"mm"')
    assert "m.toml: [model] gravity: is of a turning joint" in mistakes_in(f"{slide}[model]\ngravity = true\n")


def test_a_load_tells_the_scale_where_no_inertia_is_fitted() -> None:
    load = '[load]\ninertia = "1 kg*m^2"\n'
    assert parse_map(f"{RIGHT}{load}[model]\ninertia = false\n", place="m.toml").load.inertia is not None


def test_all_mistakes_are_told_at_once() -> None:
    said = mistakes_in(RIGHT.replace("title", "titel").replace("scale", "scal").replace('"rotation"', "3"))
    assert len(said.splitlines()) == 3


@pytest.mark.parametrize("path", sorted((ROOT / "examples" / "logs").glob("*.toml")), ids=lambda path: path.stem)
def test_the_maps_that_are_shipped_are_right(path: Path) -> None:
    found = load_map(path)
    assert found.title
    assert found.source


@pytest.mark.parametrize(
    "model",
    [
        LogSection, ColumnsSection, ColumnSection, Given, ActuatorSection, LoadSection, LoopSection, ModelSection,
        FilterSection, SplitSection,
    ],
)  # fmt: skip
def test_every_key_is_explained(model: type) -> None:
    text = (ROOT / "docs" / "logs.md").read_text()
    assert [key for key in keys_of(model) if f"`{key}`" not in text] == []


def test_the_maps_shown_are_right() -> None:
    shown = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "logs.md").read_text(), re.DOTALL)
    maps = [parse_map(each, place="docs") for each in shown]
    assert {each.translation for each in maps} == {True, False}


def test_a_gain_may_lack_the_unit_that_only_the_header_gives() -> None:
    with pytest.raises(UsageError, match=r"or give the command its unit in \[columns\]"):
        parse_map(FREE.replace('name = "u", unit = "A"', 'name = "u"'), place="map.toml")
