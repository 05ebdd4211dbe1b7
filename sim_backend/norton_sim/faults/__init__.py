"""Faults as data: what a rig file, a session or a test writes down, and how it comes true in the simulated world."""
