"""The two types and the two operational forms of an equivalent network (paper, sections II and VI.B)."""

from enum import Enum

from norton_bench.errors import UsageError


class Kind(Enum):
    """What the source gives at the port while nothing is exchanged there."""

    THEVENIN = "thevenin"  # an exertion source: what the blocked port exerts
    NORTON = "norton"  # a motion source: how the free port moves


class Form(Enum):
    """What goes in at the port, and what comes out."""

    IMPEDANCE = "impedance"  # motion in, exertion out
    ADMITTANCE = "admittance"  # exertion in, motion out


class NoConversionError(UsageError):
    """The network has no equivalent of the kind and form that was asked for; the sentence says why."""
