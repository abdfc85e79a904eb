"""Many jobs: where they run, what they share, how they end."""
