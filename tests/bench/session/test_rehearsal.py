"""A session's faults: told of before anything moves, happening in their step, and to be seen in the recording."""

from dataclasses import replace
from pathlib import Path

import pytest

from norton_bench.errors import SafetyStopError, UsageError
from norton_bench.recording.reader import read_recording
from norton_bench.records import Event, Measured
from norton_bench.rig.load import load_rig
from norton_bench.session.engine import record_session
from norton_bench.session.program import rehearsed
from norton_bench.session.schema import parse_session
from norton_drivers.errors import WiringError
from norton_drivers.hardware import HardwareBackend

RIG = load_rig(Path(__file__).parents[3] / "rigs" / "sim-odrive.toml")
HEAD = '[[step]]\ndo = "tare"\nduration = "500 ms"\n[[step]]\ndo = "calibrate"\nduration = "2 s"\n'


def only(measured: Measured, kind: str) -> Event:
    """The one event of its kind."""
    (event,) = (event for event in measured.events if event.kind == kind)
    return event


@pytest.mark.long
def test_a_fault_happens_in_its_step_and_the_recording_says_so(tmp_path: Path) -> None:
    fault = '[[fault]]\nkind = "dropout"\non = "torque_sensor"\nduring = "calibrate"\nafter = "armed"\nat = "200 ms"\n'
    with pytest.raises(SafetyStopError, match="torque sensor: silent"):
        record_session(RIG, parse_session(HEAD + fault, place="faulty.toml"), out=tmp_path, seed=1)
    recording = read_recording(tmp_path / "sim-odrive.mcap")
    stop, fault_event = (only(recording.measured, kind) for kind in ("stop", "fault"))
    assert fault_event.text == "dropout on torque_sensor"
    stale_ns = RIG.limits.stale_after_ns
    assert stale_ns < stop.stamp_ns - fault_event.stamp_ns < stale_ns + 5e6
    begun = {segment.procedure: segment.start_ns for segment in reversed(recording.measured.segments)}
    assert begun["tare"] < begun["calibrate"] < fault_event.stamp_ns < begun["calibrate"] + 250e6


@pytest.mark.long
def test_a_fault_of_the_whole_session_counts_from_its_beginning(tmp_path: Path) -> None:
    fault = '[[fault]]\nkind = "bias-jump"\non = "torque_sensor"\nat = "300 ms"\nfor = "100 ms"\nby = "20 mN*m"\n'
    session = parse_session(HEAD.partition('[[step]]\ndo = "calibrate"')[0] + fault, place="faulty.toml")
    recorded = record_session(RIG, session, out=tmp_path, seed=1, live=False)
    event = only(recorded.measured, "fault")
    torque = recorded.measured.torque
    inside = (torque["arrival_ns"] > event.stamp_ns + 5e6) & (torque["arrival_ns"] < event.stamp_ns + 95e6)
    assert torque["torque_nm"][inside].mean() == pytest.approx(0.023, abs=1e-3)
    assert "lasts_s = 0.1" in event.text


def test_on_hardware_it_is_refused() -> None:
    session = parse_session(HEAD + '[[fault]]\nkind = "drop"\non = "can0"\n', place="faulty.toml")
    with pytest.raises(
        UsageError, match=r"faulty.toml: \[\[fault\]\] is for the simulated backend only.*--backend sim"
    ):
        rehearsed(session, HardwareBackend())
    assert rehearsed(replace(session, faults=()), HardwareBackend()).happened() == []


def test_a_wrong_fault_is_told_before_anything_moves(tmp_path: Path) -> None:
    session = parse_session(HEAD + '[[fault]]\nkind = "stuck"\non = "can0"\nduring = "tare"\n', place="faulty.toml")
    with pytest.raises(WiringError, match=r'faulty.toml: \[fault 1, stuck\] on: "can0" is no place for stuck'):
        record_session(RIG, session, out=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            '[[fault]]\nkind = "drop"\nduring = "imposed"\n',
            '[fault 1] during: "imposed" is no step of this session; known',
        ),
        ("[[fault]]\nduring = 3\n", "[fault 1] during: 3 is no step of this session"),
        ("fault = [1]\n", "[fault 1]: is a section, not 1; write [[fault]] on a line of its own"),
        ('[fault]\nkind = "drop"\n', "fault: expected a list [ ... ]"),
    ],
)
def test_what_the_session_itself_can_tell_is_told_on_reading(text: str, sentence: str) -> None:
    head = text + HEAD if text.startswith("fault") else HEAD + text
    with pytest.raises(UsageError) as caught:
        parse_session(head, place="faulty.toml")
    assert str(caught.value).startswith("faulty.toml: ")
    assert sentence in str(caught.value)
