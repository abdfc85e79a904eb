"""Reduced-order model: a trunk on two spring legs, simulated in C++ with Box2D (paper section 3.2)."""
