"""The paper's claims as experiments: each measured on a simulated bench and compared with its closed form."""
