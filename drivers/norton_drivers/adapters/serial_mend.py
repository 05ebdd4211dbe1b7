"""Why a serial port cannot be opened, and what to do about it."""

import errno


def serial_mend(error: BaseException | None) -> str:
    """The half sentence after the failure; python-can wraps pyserial's error in one of its own."""
    numbers = set()
    while error is not None:
        numbers.add(getattr(error, "errno", None))
        error = error.__cause__
    if numbers & {errno.EACCES, errno.EPERM}:
        return "this user may not open it: `sudo usermod -aG dialout $USER`, then log in again"
    if numbers & {errno.EBUSY, errno.EAGAIN}:
        return "another program has it open: close that one (ModemManager and slcand are known to take such ports)"
    if errno.ENOENT in numbers:
        return "is it plugged in? `norton-bench devices` lists what is"
    return "is it a serial port, plugged in and free, and may this user open it (group dialout)?"
