"""What is told of how long served devices stood still."""

from norton_sim.standstills import Standstills

MS = 1_000_000


def told(stamps_ms: list[float]) -> str:
    standstills = Standstills()
    for stamp_ms in stamps_ms:
        standstills.goes_on(round(stamp_ms * MS))
    return str(standstills)


def test_who_was_never_late_says_so() -> None:
    assert told([100.0, 100.3, 102.3]) == "the simulated devices stood still for 2.0 ms at most"


def test_what_real_devices_would_not_have_done_is_counted() -> None:
    assert "for 12.0 ms at most, and for more than 5 ms once:" in told([0.0, 12.0, 12.3])
    assert "for 40.0 ms at most, and for more than 5 ms 2 times:" in told([0.0, 40.0, 47.0])
