"""The words of a report, for a reader who has not used the bench."""

TERMS: tuple[tuple[str, str], ...] = (
    ("port", "the actuator's output shaft: where its torque and its motion are measured, and where a load is coupled"),
    ("command (c)", "what is sent to the drive, in the unit that the rig file gives"),
    (
        "motion source (N)",
        "the motion that the shaft makes under a command when nothing holds or drives it: no torque at the port",
    ),
    (
        "impedance",
        "the torque that the actuator exerts when its shaft moves otherwise than the motion source: from friction, "
        "damping and inertia",
    ),
    (
        "Norton network",
        "motion source and impedance together: a full model of the actuator as its load feels it (Hogan 2014)",
    ),
    ("blocked", "with the shaft held still"),
    ("breakaway", "where a command becomes strong enough to move the shaft against friction"),
    (
        "presliding",
        "the motion, some milliradians, in which a friction contact bends like a spring before it slides",
    ),
    (
        "95 % interval",
        "in 95 of 100 repeated measurements of the same actuator such an interval holds the true value, if the model "
        "is right",
    ),
    ("±", "in a table: the 95 % interval reaches so far to either side of the number before it"),
    ("residual", "what is left of a measured torque when the model's prediction is subtracted"),
    ("rms", "root mean square: the usual size of a signal or an error"),
    (
        "kept apart from the fit",
        "recorded in the same session, but not used to find the parameters; so a fair test of the prediction",
    ),
    ("valid (status)", "known well enough to use; the 95 % interval holds"),
    ("learning (status)", "known, but not yet well enough to rely on; a longer session helps"),
    ("unexcited (status)", "the motion recorded says nothing of it"),
    ("at bound (status)", "the search ended at the edge of what it was allowed, so this is no result"),
    ("ratio only (status)", "known only up to a factor that it shares with other parameters"),
    ("not converged (status)", "the search did not come to an end, so this is no result"),
    ("inadequate (status)", "the actuator does something that the model lacks, and this value depends on it"),
    ("doubtful (status)", "the data contradict the model or themselves, so this is no result"),
)
