"""Learning algorithms: PPO for the teacher, SAC and the discriminator for the student."""
