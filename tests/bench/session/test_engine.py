"""A whole session on the simulated bench: what it finds, what it leaves behind, and that it can be done again."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from norton_bench.control.admittance import AdmittanceController
from norton_bench.identification.results import LiveEstimate
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import Estimate, Status
from norton_bench.procedures.waves import imposed, velocity_steps
from norton_bench.recording.contents import Recording
from norton_bench.recording.reader import read_recording
from norton_bench.recording.recover import recover
from norton_bench.recording.schemas import OUTCOME
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use
from norton_bench.session.conclusion import (
    FRICTION,
    PARAMETERS,
    REPORT,
    UNSEEN,
    check_metadata,
    conclude,
    conclude_recording,
)
from norton_bench.session.engine import RecordedSession, record_session
from norton_bench.session.live_feed import replayed
from norton_bench.session.schema import Session, Step
from norton_sim.tools import true_parameters
from tests.bench.bench_in_simulation import opened
from tests.bench.session.conclusions import fit_alone
from tests.bench.whole_session import CALIBRATE, RIG, SEED, SESSION, TARE, Performed, whole_session

METADATA_OF_THE_END = OUTCOME.encode()
TABLES = ("ticks", "motion", "load_motion", "torque", "current", "load_current")
# Beyond its own deviations no estimate may be further off than this share.
GREATEST_ERROR = {"amplifier_bandwidth": 0.15, "presliding_stiffness": 0.15, "presliding_damping": 0.15}
GREATEST_ERROR_ELSE = 0.03


def session_of(*steps: Step) -> Session:
    return Session(steps, place="test")


@pytest.fixture(scope="module")
def performed(tmp_path_factory: pytest.TempPathFactory) -> Performed:
    return whole_session(tmp_path_factory)


@pytest.fixture(scope="module")
def recording(performed: Performed) -> Recording:
    return read_recording(performed.result.recording)


@pytest.fixture(scope="module")
def again(performed: Performed, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., RecordedSession]:
    """The session's first steps once more, with another seed or the same, without live values."""
    return lambda seed, *steps: record_session(
        RIG, session_of(*steps), out=tmp_path_factory.mktemp("again"), seed=seed, live=False
    )


def estimates(performed: Performed) -> tuple[Estimate, ...]:
    assert performed.result.fit is not None
    return performed.result.fit.estimates


def test_every_parameter_is_found_within_its_own_deviation(performed: Performed) -> None:
    truth = true_parameters(RIG.simulated, seed=SEED, place="", command_unit=RIG.command.unit)
    found = {estimate.name: estimate for estimate in estimates(performed)}
    assert set(found) == set(truth)
    for name, (true, unit) in truth.items():
        estimate = found[name]
        assert (estimate.unit, estimate.status) == (unit, Status.VALID)
        assert 0.0 < abs(estimate.value - true) < 4 * estimate.std, name
        assert estimate.value == pytest.approx(true, rel=GREATEST_ERROR.get(name, GREATEST_ERROR_ELSE)), name


def test_unseen_motion_is_predicted(performed: Performed) -> None:
    fit, validation = performed.result.fit, performed.result.validation
    assert fit is not None
    assert validation is not None
    assert fit.converged
    assert 0.0 < fit.torque_relative < 0.05
    assert 0.0 < validation.torque_relative < 0.06
    assert 0.0 < validation.velocity_relative < 0.06


def test_it_leaves_recording_network_and_report(performed: Performed) -> None:
    result = performed.result
    assert sorted(path.name for path in performed.out.iterdir()) == [
        "sim-odrive.candump.log",
        "sim-odrive.mcap",
        "sim-odrive.network.json",
        "sim-odrive.report.html",
    ]
    assert result.network_file is not None
    assert result.report_file is not None
    network = NortonNetwork.load(result.network_file)
    values = {estimate.name: estimate.value for estimate in estimates(performed)}
    assert (network.inertia_kgm2, network.coulomb_torque_nm) == (values["inertia"], values["coulomb_torque"])
    assert network.provenance["seed"] == str(SEED)
    report = result.report_file.read_text()
    assert all(name.replace("_", " ") in report or name in report for name in values)


@pytest.mark.long
@pytest.mark.parametrize("table", TABLES)
def test_the_recording_holds_what_was_measured(performed: Performed, recording: Recording, table: str) -> None:
    measured = getattr(performed.result.measured, table)
    assert len(measured) > 100
    assert getattr(recording.measured, table).tobytes() == measured.tobytes()


def test_the_recording_says_in_which_segments_and_from_which_rig(performed: Performed, recording: Recording) -> None:
    assert recording.complete
    assert recording.measured.segments == performed.result.measured.segments
    assert recording.rig_text == RIG.text
    procedures = dict.fromkeys(segment.procedure for segment in recording.measured.segments)
    assert list(procedures) == [step.do for step in SESSION.steps]


def test_raw_frames_tell_everything_that_was_commanded(recording: Recording) -> None:
    """Two commands a tick, of four bytes each at least, on the one bus."""
    ticks = len(recording.measured.ticks)
    sent = [frame for frame in recording.measured.frames if frame.sent and frame.channel == "can0"]
    assert 2 * ticks < len(sent) < 2.1 * ticks


def test_a_recording_alone_gives_the_very_same_result(performed: Performed, tmp_path: Path) -> None:
    told: list[str] = []
    result = conclude_recording(performed.result.recording, tmp_path, told.append)
    assert told == [PARAMETERS, FRICTION, UNSEEN, REPORT]
    assert result.fit is not None
    assert result.fit.estimates == estimates(performed)
    first, second = performed.result.validation, result.validation
    assert first is not None
    assert second is not None
    assert (second.torque_rms_nm, second.velocity_rms_rad_s) == (first.torque_rms_nm, first.velocity_rms_rad_s)
    assert result.network_file is not None
    assert performed.result.network_file is not None
    then = json.loads(performed.result.network_file.read_text())
    now = json.loads(result.network_file.read_text())
    assert now.pop("provenance").items() >= then.pop("provenance").items()
    assert now == then


@pytest.mark.long
def test_a_validation_that_was_not_read_costs_no_fit(performed: Performed, tmp_path: Path) -> None:
    measured = performed.result.measured
    begun_ns = next(segment.start_ns for segment in measured.segments if segment.use is Use.VALIDATE)
    deaf = replace(measured, torque=measured.torque[measured.torque["arrival_ns"] < begun_ns])
    recording = read_recording(performed.result.recording, raw_frames=False)
    with fit_alone():
        result = conclude(
            deaf,
            rig_text=recording.rig_text,
            metadata=recording.metadata,
            live=(),
            recording=tmp_path / "deaf",
            out=tmp_path,
        )
    assert result.validation is None
    assert result.fit is not None
    assert result.fit.converged
    assert any(sentence.startswith("validation: too little was read") for sentence in result.fit.verdict)


@pytest.mark.long
def test_a_recording_that_lost_its_end_and_was_recovered_tells_the_very_same(
    recording: Recording, performed: Performed, tmp_path: Path
) -> None:
    """As a kill leaves it that comes after the last part was written: of this, what a result follows from."""
    killed = tmp_path / "killed.mcap"
    content = performed.result.recording.read_bytes()
    killed.write_bytes(content[: content.index(METADATA_OF_THE_END) - 20])
    recovered = read_recording(recover(killed).path)
    for table in TABLES:
        assert getattr(recovered.measured, table).tobytes() == getattr(recording.measured, table).tobytes(), table
    assert recovered.measured.segments == recording.measured.segments
    assert recovered.measured.chain == recording.measured.chain
    assert recovered.live == recording.live
    assert recovered.rig_text == recording.rig_text
    assert recovered.metadata.items() <= recording.metadata.items()
    check_metadata(killed, recovered.metadata)


@pytest.mark.long
def test_replaying_a_recording_gives_the_same_live_estimates(recording: Recording) -> None:
    """Up to rounding, which depends on where in memory numbers lie."""
    recorded = recording.live
    again = {one.stamp_ns: one for one in replayed(recording)}
    assert list(again) == [one.stamp_ns for one in recorded]
    assert len(recorded[-1].estimates) == 7
    for one in recorded:
        assert again[one.stamp_ns].samples == one.samples
        for mine, theirs in zip(again[one.stamp_ns].estimates, one.estimates, strict=True):
            assert (mine.name, mine.status) == (theirs.name, theirs.status)
            assert mine.value == pytest.approx(theirs.value, abs=1e-6 * theirs.std)
            assert mine.std == pytest.approx(theirs.std, rel=1e-6)


# Of bench time: two seconds of a busy computer's.
WORKED_OUT_NS = 15_000_000_000


def valid_from_ns(live: list[LiveEstimate]) -> int:
    return next(estimate.stamp_ns for estimate in live if estimate.network is not None)


def test_live_estimates_are_valid_long_before_the_end(performed: Performed, recording: Recording) -> None:
    ticks = performed.result.measured.ticks["tick_ns"]
    known_after = (valid_from_ns(performed.live) - ticks[0]) / (ticks[-1] - ticks[0])
    assert 0.05 < known_after < 0.6
    recorded = recording.live
    assert len(recorded) > 0.9 * len(performed.live)
    assert recorded[-1].estimates == performed.live[-1].estimates


def test_the_last_live_estimate_agrees_with_the_final_fit(performed: Performed) -> None:
    final = {estimate.name: estimate for estimate in estimates(performed)}
    last = performed.live[-1].estimates
    assert len(last) >= 7
    for estimate in last:
        reference = final[estimate.name]
        assert estimate.status is Status.VALID
        assert abs(estimate.value - reference.value) < 4 * np.hypot(estimate.std, reference.std), estimate.name


def test_zero_torque_is_foreseen_as_soon_as_the_network_is_known(performed: Performed, recording: Recording) -> None:
    known_ns = valid_from_ns(performed.live)
    free = [
        segment
        for segment in recording.measured.segments
        if segment.procedure == "free" or segment.name == "free multisine"
    ]
    # An estimate is stamped with its last reading, and comes when it is worked out: the simulated bench has gone on.
    known = [segment.start_ns > known_ns for segment in free]
    late = [segment.start_ns > known_ns + WORKED_OUT_NS for segment in free]
    assert all(
        at_last <= segment.preview <= at_first for at_last, segment, at_first in zip(late, free, known, strict=True)
    )
    previews = [segment.preview for segment in free]
    assert previews == sorted(previews)  # once known, in every one that follows
    assert any(segment.preview and segment.use is Use.IDENTIFY for segment in free)
    assert not any(segment.preview for segment in recording.measured.segments if "imposed" in segment.name)


@pytest.mark.long
def test_the_same_seed_gives_the_same_tables(performed: Performed, again: Callable[..., RecordedSession]) -> None:
    """Identifying while it runs changes nothing of what is measured."""
    second = again(SEED, TARE, CALIBRATE)
    assert performed.result.live
    assert not second.live
    for name in TABLES:
        table = getattr(second.measured, name)
        assert len(table) > 100
        assert table.tobytes() == getattr(performed.result.measured, name)[: len(table)].tobytes(), name


@pytest.mark.long
def test_another_seed_gives_others(performed: Performed, again: Callable[..., RecordedSession]) -> None:
    second = again(SEED + 1, TARE).measured.torque["torque_nm"][:400]
    first = performed.result.measured.torque["torque_nm"][:400]
    assert np.count_nonzero(second == first) < 40


def steady_turning(rig: Rig, velocity_rad_s: float) -> Any:
    motion = velocity_steps(np.array([velocity_rad_s]), 0.15, 0.35, rig.tick_s)
    return imposed("test", "turning", Use.PREPARE, np.zeros(len(motion.position_rad)), motion)


@pytest.mark.parametrize("where", ["before it reads", "before it commands"])
@pytest.mark.parametrize("stall_ms", [2, 8])
def test_a_loop_that_misses_ticks_keeps_the_motion(performed: Performed, stall_ms: int, where: str) -> None:
    calibration = performed.result.knowledge.calibration
    assert calibration is not None
    with opened(RIG) as bench:
        loop, clock, link, asked = bench.loop, bench.backend.clock, bench.devices.link, 0
        loop.controller = AdmittanceController(calibration, RIG.tick_s, RIG.limits.load_torque_nm)
        loop.alignment.torque_bias_nm = calibration.torque_bias_nm
        poll = link.poll

        def stand_still() -> None:
            nonlocal asked
            asked += 1
            if asked > 200 and asked % 50 == 0:
                clock.wait_until_ns(clock.now_ns() + round((stall_ms + 0.4) * 1e6))

        def poll_late() -> int:
            stand_still()
            return poll()

        with loop.running():
            if where == "before it reads":
                link.poll = poll_late  # type: ignore[method-assign]
            else:
                loop.stop_request = stand_still
            measured = loop.run(steady_turning(RIG, 30.0))
            link.poll = poll  # type: ignore[method-assign]
    ticks = measured.ticks
    assert loop.skipped_ticks >= 5 * (stall_ms - 1)
    assert 0 <= np.min(ticks["lateness_ns"]) <= np.max(ticks["lateness_ns"]) < RIG.tick_ns
    error = ticks["velocity_rad_s"] - ticks["reference_velocity_rad_s"]
    assert np.sqrt(np.mean(error**2)) < 1.5
