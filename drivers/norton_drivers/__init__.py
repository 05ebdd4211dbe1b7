"""Bytes, ports and time: everything between the bench and a device's connector. Imports nothing of ours."""
