"""What accompanies a training: checkpoints, statistics, the choice of the policy."""
