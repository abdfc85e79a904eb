"""What finished evaluations say together: statistics over seeds, the paper's claims, the tables of sweeps."""
