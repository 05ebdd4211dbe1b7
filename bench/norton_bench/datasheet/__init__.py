"""The data sheet: what follows from an identified network, and what its recording adds."""
