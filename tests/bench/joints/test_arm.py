"""Files of arms, and their mistakes."""

import shutil
from pathlib import Path

import pytest

from norton_bench.errors import RigError
from norton_bench.joints.arm import load_arm

SHIPPED = Path(__file__).parents[3] / "rigs" / "two-joints"


@pytest.fixture
def folder(tmp_path):
    copied = tmp_path / "two-joints"
    shutil.copytree(SHIPPED, copied)
    return copied


def changed(path: Path, before: str, after: str) -> None:
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))


def test_the_shipped_arm_is_read(folder):
    arm = load_arm(folder / "arm.toml")
    assert [rig.name for rig in arm.rigs] == ["shoulder", "elbow"]
    assert arm.reach is not None
    assert arm.reach.commands == (0.3, -0.2)
    assert arm.is_simulated


@pytest.mark.parametrize(
    ("file", "before", "after", "sentence"),
    [
        ("arm.toml", 'elbow = "elbow.toml"', "", r"arm.toml: \[joints\] elbow: is missing; add elbow = "),
        ("arm.toml", "[reach]", "[raech]", r"arm.toml: \[raech\]: unknown section"),
        ("arm.toml", 'swing = "30 mrad"', 'swing = "2 rad"', r"\[impedance\] swing: 2 must be at most 0.5|at most 0.5"),
        ("arm.toml", 'highest = "8 Hz"', 'highest = "1 Hz"', "fewer than 5 odd multiples of 1/period"),
        ("arm.toml", 'shoulder = "0.3 rad"', 'shoulder = "3 rad"', r"\[reach\] shoulder: 3 rad is not within -0.5 to"),
        ("arm.toml", 'shoulder = "0.3 rad"', 'shoulder = "3 N*m"', r"\[reach\] shoulder: "),
        ("elbow.toml", 'rate = "1 kHz"', 'rate = "500 Hz"', "the rigs have different rates"),
        ("elbow.toml", 'name = "elbow"', 'name = "shoulder"', 'both rigs are called "shoulder"'),
        ("elbow.toml", 'backend = "simulated"', 'backend = "hardware"', "one rig is simulated and the other is not"),
        ("elbow.toml", "239.74.163.12", "239.74.163.11", "both rigs have a device at node 1 of udp_multicast"),
        (
            "elbow.toml",
            "norton-bench/elbow",
            "norton-bench/shoulder",
            "both rigs have a device at /tmp/norton-bench/sh",
        ),
        (
            "arm.toml",
            'elbow = "1.6 rad"\n\n[impedance]',
            'elbow = "0 rad"\n\n[impedance]',
            "stretched out or folded",
        ),
        ("elbow.toml", 'torque = "40 N*m"', 'torque = "40 N"', r"elbow.toml: \[limits\] torque"),
    ],
)
def test_mistakes_are_told_with_place_and_mend(folder, file, before, after, sentence):
    changed(folder / file, before, after)
    with pytest.raises(RigError, match=sentence):
        load_arm(folder / "arm.toml")


def test_a_rig_file_is_no_arm(folder):
    with pytest.raises(RigError, match="is a rig file, not an arm file"):
        load_arm(folder / "elbow.toml")


def test_an_arm_file_that_is_missing_is_told(folder):
    with pytest.raises(RigError, match="no such arm file"):
        load_arm(folder / "leg.toml")
