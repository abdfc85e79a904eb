"""How long a walker is asked for a cell of the grid of commands when it is evaluated: in the key of the evaluation."""

EPISODE_SECONDS = 10.0
