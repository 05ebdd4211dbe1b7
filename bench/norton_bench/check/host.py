"""What of this computer matters to the loop: whether it may run in real time, and how late it wakes up."""

from collections.abc import Iterator

import numpy as np

from norton_bench.check.findings import HostCheck
from norton_bench.rig.rig import Rig
from norton_drivers.clock import Clock
from norton_drivers.discovery import serial_obstacles
from norton_drivers.punctual import LOOP_PRIORITY, permitted_priority

_TICKS = 500


def look_at_host(rig: Rig, clock: Clock) -> HostCheck:
    """Wait for some hundred ticks as the loop does, and note how late each came [s]."""
    late_s = np.empty(_TICKS)
    deadline_ns = clock.now_ns()
    for index in range(_TICKS):
        deadline_ns += rig.tick_ns
        clock.wait_until_ns(deadline_ns)
        now_ns = clock.now_ns()
        late_s[index] = (now_ns - deadline_ns) * 1e-9
        deadline_ns = max(deadline_ns, now_ns - rig.tick_ns)  # a stall is one late tick, not many
    median_s, tail_s = np.percentile(late_s, (50, 99))
    return HostCheck(permitted_priority(LOOP_PRIORITY) > 0, float(median_s), float(tail_s), float(late_s.max()))


def host_remarks(host: HostCheck, rig: Rig) -> Iterator[str]:
    """What should be mended of it, or allowed for in the rig file."""
    if not host.real_time:
        yield (
            f"this computer: the loop may not run in real time; add `@realtime - rtprio {LOOP_PRIORITY}` for your "
            "group to /etc/security/limits.conf and log in again"
        )
    most_s, stall_s, stale_s = host.late_most_s, rig.limits.stall_after_ns * 1e-9, rig.limits.stale_after_ns * 1e-9
    for key, limit_s in (("stall_after", stall_s), ("stale_after", stale_s)):
        if most_s > 0.5 * limit_s:
            yield (
                f"this computer: it stood still for {most_s * 1e3:.0f} ms while it was watched, more than half of "
                f"[limits] {key} = {limit_s * 1e3:g} ms; quieten it, or raise the limit"
            )
    for device in rig.wiring.devices():
        for obstacle in serial_obstacles(device.port) if device.port else ():
            yield f"[{device.role}] port {device.port}: {obstacle}"
