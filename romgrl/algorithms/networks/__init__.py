"""Networks with their gradients, and what normalises their input."""
