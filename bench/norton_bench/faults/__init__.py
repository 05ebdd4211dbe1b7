"""Every fault on every rig: rehearsed on the simulated backend, and judged by what is true there."""
