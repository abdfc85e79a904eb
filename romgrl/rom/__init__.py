"""Reduced-order model: a trunk on two spring legs, simulated in C++ (paper section 3.2)."""
