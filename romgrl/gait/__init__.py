"""What a gait is: its features, its description in numbers, and its distance to another gait."""
