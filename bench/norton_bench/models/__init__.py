"""Actuators as the paper writes them: equations and parameters, no integrators."""
