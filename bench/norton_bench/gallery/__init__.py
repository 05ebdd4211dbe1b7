"""The paper's claims as experiments: each measured on a simulated bench, and laid beside its closed form."""
