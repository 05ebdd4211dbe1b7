"""What the system said, out of what libraries made of it."""

import pytest

from norton_drivers.errors import reason_of


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (
            OSError("[Errno 2] could not open port x: [Errno 2] No such file or directory: 'x'"),
            "No such file or directory",
        ),
        (FileNotFoundError(2, "No such file or directory", "x"), "No such file or directory"),
        (OSError("read failed: ([Errno 5] Input/output error)"), "Input/output error"),
        (OSError("device disconnected or\nmultiple access"), "device disconnected or multiple access"),
        (ValueError(), "ValueError"),
    ],
)
def test_the_reason_is_told_once_and_without_numbers(error: Exception, reason: str) -> None:
    assert reason_of(error) == reason
