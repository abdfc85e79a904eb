"""What the seed of a stage is moved by, so that no two of them draw the same resets; a training has the seed itself."""

TEACHER_GAIT = 10_000
REFERENCE = 20_000
EVALUATION = 30_000
ROBUSTNESS = 40_000
WATCH = 50_000
