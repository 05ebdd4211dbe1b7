"""Every kind of fault on every rig, run on the simulated backend and judged by its true state."""
