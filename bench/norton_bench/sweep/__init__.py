"""Many fits: the same experiment at many seeds, or the recordings of a whole fleet, over any executor."""
