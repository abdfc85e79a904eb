"""Figures, tables and films from finished artifacts. Nothing here runs a policy or a simulation."""

import logging

logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it warns of a home that it cannot write
