"""Turnwell T1 drives for Norton Bench."""
