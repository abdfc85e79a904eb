"""Figures, tables and films from finished artifacts. Nothing here runs a policy or a simulation."""
