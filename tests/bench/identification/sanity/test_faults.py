"""Bad recordings: every fault is named or refused, or does no harm; no wrong number is called valid."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from norton_bench.errors import ExperimentError
from norton_bench.identification import bootstrap
from norton_bench.identification.cleaning import NOTHING_FOUND, clean
from norton_bench.identification.judged_fit import fit
from norton_bench.models.parameters import Status
from tests.bench.identification import synthetic
from tests.bench.identification.sanity import faulty
from tests.bench.identification.sanity.faulty import command, late, position, rows, stepped, torque, values, without
from tests.bench.identification.synthetic import NAMES, TICK_S, Bench, Truth

# Records simulated where statuses and sentences are looked at, and no deviation: half of the usual number.
DRAWS = bootstrap.DRAWS // 2
# Fits that are right differ from the truth by less than this many deviations.
RIGHT = 4.0
FEW = settings(max_examples=4, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def identified(measured, draws=0):
    """Without simulated records deviations are narrower: a wrong number is found out the sooner."""
    return fit(measured, command_unit="N*m", tick_s=TICK_S, draws=draws)


def confident_and_wrong(result):
    """Estimates that are called valid and lie far from the truth."""
    truth = Truth()
    valid = [result.estimate(name) for name in NAMES if result.estimate(name).status is Status.VALID]
    return [each for each in valid if not abs(each.value - getattr(truth, each.name)) < RIGHT * each.std]


@pytest.fixture(scope="module")
def imposed():
    return synthetic.experiment(1, free=False, blocked=False)


@pytest.fixture(scope="module")
def short():
    return synthetic.brief(1)


# Left out or bridged; the numbers stay right. What is said of it, if anything.
HARMLESS = {
    "torque not finite": (torque(faulty.spots(np.nan, 50)), "torque: 50 of .* not finite"),
    "torque not finite for long": (torque(faulty.spots(np.inf, 20, 100)), "torque: .* not finite"),
    "position not finite": (position(faulty.spots(np.nan, 50)), "position of the actuator: .* not finite"),
    "command not finite": (command(faulty.spots(np.nan, 50)), "command: .* not finite"),
    "current not finite": (values("current", "current_a", faulty.spots(np.nan, 50)), "current: .* not finite"),
    "spikes of torque": (torque(faulty.spots(5.0, 20)), "torque: .* stand alone"),
    "spikes of position": (position(lambda good: good + faulty.spots(3.0, 20)(0 * good)), "position.* stand alone"),
    "torque missing for 20 ms": (rows("torque", without(20, 30)), None),
    "torque missing for 2 s": (rows("torque", without(2000)), None),
    "torque missing for half": (rows("torque", without(10**9, at=0.5)), None),
    "position missing for 20 ms": (rows("motion", without(20, 30)), None),
    "position missing for half": (rows("motion", without(10**9, at=0.5)), None),
    "ticks missing for 2 s": (rows("ticks", without(2000)), None),
    "torque's arrival set forward": (values("torque", "arrival_ns", stepped(10**9)), "torque: a clock jumped"),
    "torque's arrival set back a little": (values("torque", "arrival_ns", stepped(-5 * 10**6)), "a clock jumped"),
    "position's arrival set forward": (values("motion", "arrival_ns", stepped(10**9)), "position.*a clock jumped"),
    "position's arrival set back": (values("motion", "arrival_ns", stepped(-(10**9))), "position.*a clock jumped"),
    "sensor's clock jumps": (values("torque", "device_ns", stepped(-(2**32) * 1000)), "torque: a clock jumped"),
    "sensor's clock stands still": (
        values("torque", "device_ns", lambda good: 0 * good + good[0]),
        "own clock stands still",
    ),
    "tick's clock set forward": (values("ticks", "tick_ns", stepped(10**9)), "command: a clock jumped"),
    "tick's clock set back": (values("ticks", "tick_ns", stepped(-(10**9))), "command: a clock jumped"),
    "torque frozen": (torque(faulty.stuck(0.6, 0.9)), "torque is frozen in 30.0%"),
    "position frozen": (position(faulty.stuck(0.6, 0.9)), "position of the actuator is frozen in 30.0%"),
    "torque saturated": (torque(faulty.clipped(0.6)), "torque is saturated, flat at"),
    "torque repeated": (torque(faulty.held(5)), "torque: each reading is repeated 5 times"),
    "torque drifts": (torque(lambda good: good + np.linspace(0, 0.1, good.size)), None),
    "torque half a tick late": (late("torque", 500_000), None),
    "torque 5 ticks late": (late("torque", 5_000_000), None),
    "segments moved": (faulty.moved_segments(10**9), None),
    "position only one way": (faulty.one_way, None),
}
# Nothing is left of these.
UNDONE = {
    "torque twice": rows("torque", lambda table: np.repeat(table, 2)),
    "position twice": rows("motion", lambda table: np.repeat(table, 2)),
    "torque out of order": rows("torque", faulty.shuffled),
    "position out of order": rows("motion", faulty.shuffled),
    "ticks out of order": rows("ticks", faulty.shuffled),
}
# Nothing is valid, and the reason is named.
DOUBTFUL = {
    "torque's sign": (torque(np.negative), "inertia comes out negative"),
    "position's sign": (position(np.negative), "velocity is -1 times"),
    "position in degrees": (position(np.degrees), "velocity is 0.0175 times"),
    "torque and velocity swapped": (faulty.torque_and_velocity_swapped, "not the derivative"),
    "commands swapped": (faulty.commands_swapped, "inertia comes out negative"),
    "values in disorder": (torque(np.random.default_rng(4).permutation), "unexplained"),
    "position repeated": (position(faulty.held(5)), "read only every 5 ms"),
    "encoder jumps": (position(stepped(2 * np.pi)), "leaps once"),
    "encoder slips": (position(faulty.slipping), "loses counts"),
    "encoder creeps": (position(lambda good: good + 1e-4 * np.arange(good.size)), "loses counts"),
    "encoder wraps": (position(lambda good: np.mod(good, 2 * np.pi)), "not the derivative"),
    "torque 50 ms late": (late("torque", 50_000_000), "unexplained"),
    "position 9 ms late": (late("motion", 9_000_000), "out of step"),
    "noise for torque": (
        torque(lambda good: 1e-3 * np.random.default_rng(1).standard_normal(good.size)),
        "unexplained",
    ),
    "command frozen": (command(faulty.stuck(0.6, 0.9)), "unexplained"),
    "a second": (faulty.part(10, 1), "too little to say how good"),
}
# The same, of what a longer record shows, with constant speeds in it.
DOUBTFUL_AT_LENGTH = {
    "torque ten times": (torque(lambda good: 10 * good), "reads 8.9 times what the load drive"),
    "encoders swapped": (faulty.motions_swapped, "twists against the torque"),
    "torque's gain creeps": (torque(lambda good: good * np.linspace(1, 1.3, good.size)), "not the same throughout"),
    "position's clock jumps": (values("motion", "arrival_ns", stepped(-5 * 10**6)), "delay.*not the same throughout"),
}
REFUSED = {
    "torque repeated for 50 ms": (torque(faulty.held(50)), "repeated 50 times"),
    "torque never finite": (torque(lambda good: np.nan * good), "no reading of torque is a finite"),
    "position never finite": (position(lambda good: np.nan * good), "no reading of position"),
    "command never finite": (command(lambda good: np.nan * good), "no reading of command"),
    "torque never valid": (values("torque", "valid", np.zeros_like), "no reading of torque is valid"),
    "torque constant": (torque(lambda good: 0 * good + 0.01), "torque never changes"),
    "position constant": (position(lambda good: 0 * good + 1.0), "position of the actuator never changes"),
    "command constant": (command(lambda good: 0 * good + 0.01), "never commanded"),
    "segments elsewhere": (faulty.moved_segments(10**11), "nothing was recorded"),
}


@pytest.mark.long
@pytest.mark.parametrize(("fault", "said"), HARMLESS.values(), ids=HARMLESS)
def test_what_can_be_left_out_does_no_harm(short, fault, said):
    result = identified(fault(short))
    assert_all_is_right(result)
    if said is None:
        assert result.verdict == ()
    else:
        assert_said(said, result)


def assert_all_is_right(result):
    assert not confident_and_wrong(result)
    assert all(estimate.status is Status.VALID for estimate in result.estimates), result.verdict


@pytest.mark.parametrize("fault", UNDONE.values(), ids=UNDONE)
def test_what_can_be_undone_leaves_no_trace(short, fault):
    assert_untouched(clean(fault(short)), short)


def assert_untouched(kept, good):
    assert kept.findings == NOTHING_FOUND
    for name in ("ticks", "motion", "load_motion", "torque", "current"):
        assert np.array_equal(getattr(kept.measured, name), getattr(good, name)), name


GAPS = ("torque not finite for long", "torque saturated", "position missing for 20 ms", "ticks missing for 2 s")


def gaps_in_all(measured):
    for name in GAPS:
        measured = HARMLESS[name][0](measured)
    return measured


SIMULATED = {
    "gaps in all": gaps_in_all,
    "torque repeated": HARMLESS["torque repeated"][0],
    "position only one way": HARMLESS["position only one way"][0],
}


@pytest.mark.long
@pytest.mark.parametrize("fault", SIMULATED.values(), ids=SIMULATED)
def test_records_with_the_same_gaps_can_be_simulated(short, fault):
    assert_all_is_right(identified(fault(short), DRAWS))


@pytest.mark.long
@pytest.mark.parametrize(("fault", "said"), DOUBTFUL.values(), ids=DOUBTFUL)
def test_what_contradicts_itself_is_named_and_no_number_is_valid(short, fault, said):
    assert_none_is_valid(said, identified(fault(short)))


@pytest.mark.parametrize(("fault", "said"), DOUBTFUL_AT_LENGTH.values(), ids=DOUBTFUL_AT_LENGTH)
def test_what_contradicts_itself_at_length_is_named_and_no_number_is_valid(imposed, fault, said):
    assert_none_is_valid(said, identified(fault(imposed)))


def assert_none_is_valid(said, result):
    assert not any(estimate.status is Status.VALID for estimate in result.estimates)
    assert_said(said, result)


@pytest.mark.parametrize(("fault", "said"), REFUSED.values(), ids=REFUSED)
def test_what_tells_nothing_is_refused(short, fault, said):
    with pytest.raises(ExperimentError, match=said):
        identified(fault(short))


@pytest.mark.long
def test_a_clock_that_jumps_by_less_than_any_gap_is_seen_in_the_delay(experiment):
    result = identified(values("ticks", "tick_ns", stepped(5 * 10**6))(experiment))
    assert not any(estimate.status is Status.VALID for estimate in result.estimates)
    assert_said("delay between command and torque is not the same throughout", result)


def test_a_reversed_command_makes_only_the_gain_doubtful(short):
    result = identified(command(np.negative)(short))
    assert result.estimate("torque_gain").status is Status.DOUBTFUL
    assert_said("drives the shaft backwards", result)
    assert not confident_and_wrong(result)
    assert result.estimate("inertia").status is Status.VALID


@pytest.mark.parametrize("every", [2, 5])
def test_a_slow_torque_sensor_is_no_fault(short, every):
    result = identified(replace(short, torque=short.torque[::every]))
    assert not confident_and_wrong(result)
    assert result.verdict == ()


BENCHES = {
    "cogging": Bench(cogging_nm=3e-3),
    "16384 counts": Bench(counts=16384.0),
    "no clock of its own": Bench(device_clock=False),
    "much jitter": Bench(can_jitter_s=200e-6, serial_jitter_s=400e-6),
}


@pytest.mark.long
@pytest.mark.parametrize("bench", BENCHES.values(), ids=BENCHES)
def test_a_bench_that_is_merely_imperfect_raises_no_alarm(bench):
    measured = synthetic.brief(1, bench=bench)
    assert clean(measured).findings == NOTHING_FOUND
    assert identified(measured, DRAWS).verdict == ()


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_other_true_values_raise_no_alarm(seed):
    factors = 2 ** np.random.default_rng(seed).uniform(-1, 1, 7)
    measured = synthetic.brief(seed, Truth(*(Truth().array() * factors)))
    assert clean(measured).findings == NOTHING_FOUND
    assert identified(measured, DRAWS).verdict == ()


def test_good_recordings_are_left_as_they_are(experiment):
    assert_untouched(clean(experiment), experiment)


def right_or_said_otherwise(measured):
    """Right, or not valid, or refused."""
    try:
        result = identified(measured)
    except ExperimentError:
        return
    assert not confident_and_wrong(result), result.verdict


SPANS = st.lists(st.tuples(st.floats(0, 1), st.integers(1, 3000)), min_size=1, max_size=5)
TABLES = st.sampled_from([("torque", "torque_nm"), ("motion", "position_rad"), ("ticks", "command")])


@pytest.mark.long
@given(TABLES, SPANS, st.sampled_from([np.nan, np.inf, -np.inf]))
@FEW
def test_spans_that_are_not_finite(short, where, spans, bad):
    def change(good):
        for start, length in spans:
            first = int(start * good.size)
            good[first : first + length] = bad
        return good

    right_or_said_otherwise(values(*where, change)(short))


@pytest.mark.long
@given(TABLES, SPANS)
@FEW
def test_gaps(short, where, spans):
    def change(table):
        for start, length in spans:
            first = int(start * len(table))
            table = np.delete(table, slice(first, first + length))
        return table

    right_or_said_otherwise(rows(where[0], change)(short))


@pytest.mark.long
@given(TABLES, st.integers(0, 10**6), st.integers(2, 2000), st.integers(1, 20))
@FEW
def test_rows_in_disorder(short, where, seed, longest, pieces):
    def change(table):
        order, random = np.arange(len(table)), np.random.default_rng(seed)
        for start in random.integers(0, len(table), pieces):
            order[start : start + longest] = random.permutation(order[start : start + longest])
        return table[order]

    right_or_said_otherwise(rows(where[0], change)(short))


@pytest.mark.long
@given(st.sampled_from([torque, position]), st.sampled_from([-1.0, 1.0]), st.floats(0.5, 3.0))
@FEW
def test_scales(short, column, sign, decades):
    """More than what a load drive's own torque constant may be off by."""
    scale = sign * 10**decades
    right_or_said_otherwise(column(lambda good: scale * good)(short))


@pytest.mark.long
@given(TABLES, st.floats(0.1, 0.9), st.integers(-(10**10), 10**10))
@FEW
def test_clock_jumps(short, where, at, by_ns):
    stamp = "tick_ns" if where[0] == "ticks" else "arrival_ns"
    right_or_said_otherwise(values(where[0], stamp, stepped(by_ns, at))(short))


def assert_said(said, result):
    assert any(re.search(said, sentence) for sentence in result.verdict), result.verdict
