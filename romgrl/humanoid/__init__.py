"""The planar humanoid: model, observation, task, environments and pictures."""
