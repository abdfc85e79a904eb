"""A policy in a world, with no learning."""
