"""What a driver said again while no message came is put where the sensor left something out, and nowhere else."""

import numpy as np
import pytest

from norton_bench.identification.readings import one_a_period, sampled_at_s
from norton_bench.records import NO_DEVICE_TIME, TORQUE, Table

MS = 1_000_000
READINGS = 4000


def as_driven(arrival_ns: np.ndarray, number: np.ndarray) -> Table:
    """The readings of a driver that says the last value again after one and a half periods without a message.

    ``number`` are the places of the messages on the sensor's own clock; the torque of each is that number.
    """
    rows, last_ns = list[tuple[int, int, int, float, bool]](), int(arrival_ns[0]) - MS
    for message, (now_ns, place) in enumerate(zip(arrival_ns.tolist(), number.tolist(), strict=True)):
        while rows and now_ns - last_ns >= 1.5 * MS:
            last_ns += MS
            rows.append((last_ns, NO_DEVICE_TIME, message - 1, rows[-1][3], True))
        rows.append((now_ns, NO_DEVICE_TIME, message, float(place), True))
        last_ns = now_ns
    return np.array(rows, TORQUE)


def stalled(number: np.ndarray, stalls_ms: dict[int, float]) -> np.ndarray:
    """Arrivals [ns] of a stream that a computer hands on a little late, and all at once after each stall."""
    arrival_ns = number * MS + np.random.default_rng(1).uniform(0, 0.2 * MS, number.size)
    for place, stall_ms in stalls_ms.items():
        late = (number >= place) & (number < place + stall_ms)
        arrival_ns[late] = (place + stall_ms) * MS + 0.01 * MS * np.arange(np.count_nonzero(late))
    return np.maximum.accumulate(arrival_ns).round().astype(np.int64)


def errors_ms(table: Table) -> np.ndarray:
    """By how much a reading seems to have been taken at another time than the value that it has."""
    late_ms = 1e3 * sampled_at_s(table["arrival_ns"], None, 0) - table["torque_nm"]
    return np.asarray(late_ms - np.median(late_ms))


STALLS = {300: 4.0, 900: 20.0, 901 + 60: 7.0, 2000: 35.0, 3100: 3.0, 3500: 12.0}


def test_late_messages_are_no_left_out_ones() -> None:
    number = np.arange(READINGS)
    table = as_driven(stalled(number, STALLS), number)
    assert len(table) > READINGS + 50
    assert np.max(np.abs(errors_ms(table))) > 20.0  # counted as they stand
    regular = one_a_period(table)
    assert len(regular) == READINGS
    assert np.max(np.abs(errors_ms(regular))) < 0.1


def test_left_out_ones_stay_where_they_were() -> None:
    number = np.arange(READINGS)
    kept = np.random.default_rng(2).random(READINGS) < 0.7
    kept[[0, -1]] = True
    table = as_driven(stalled(number[kept], {}), number[kept])
    regular = one_a_period(table)
    assert len(regular) == READINGS
    held = np.maximum.accumulate(np.where(kept, number, 0))
    assert regular["torque_nm"].tolist() == held.tolist()


def test_both_at_once() -> None:
    number = np.arange(READINGS)
    kept = np.random.default_rng(3).random(READINGS) < 0.8
    kept[[0, -1]] = True
    regular = one_a_period(as_driven(stalled(number[kept], STALLS), number[kept]))
    assert len(regular) == READINGS
    held = np.maximum.accumulate(np.where(kept, number, 0))
    assert np.mean(regular["torque_nm"] == held) > 0.98


def test_a_silence_at_the_end_stays() -> None:
    table = as_driven(np.arange(10) * MS, np.arange(10))
    silent = np.repeat(table[-1:], 50)
    silent["arrival_ns"] += (np.arange(50) + 1) * MS
    regular = one_a_period(np.concatenate([table, silent]))
    assert len(regular) == 60
    assert np.diff(regular["arrival_ns"]).tolist() == [MS] * 59


@pytest.mark.parametrize("numbers", [np.arange(100), np.zeros(100, int)], ids=["a message each", "no numbers at all"])
def test_others_are_left_as_they_are(numbers: np.ndarray) -> None:
    table = np.zeros(100, TORQUE)
    table["sequence"], table["torque_nm"], table["arrival_ns"] = numbers, np.arange(100), np.arange(100) * MS
    assert one_a_period(table) is table
