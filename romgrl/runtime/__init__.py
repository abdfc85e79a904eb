"""What a running stage may always use: its log, signals, standard streams, cores, the environment."""
