"""The last check before commands are sent: limits, plausibility between signals, and what they are told of the bench.

It imports no controller and no procedure, and they do not import it: what one of them gets wrong, it still sees.
"""
