"""Trained walkers that ship with the package, and what ships others in their place."""
