"""Servos that share one half-duplex serial line, and the master that says who may speak."""
