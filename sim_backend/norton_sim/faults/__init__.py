"""Faults as data, written in a rig file, a session or a test, and how the simulator makes them happen."""
