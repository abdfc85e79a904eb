"""What the seed of a stage is moved by, so that no two of them draw the same resets; a training has the seed itself."""

TEACHER_GAIT_SEED = 10_000
REFERENCE_SEED = 20_000
EVALUATION_SEED = 30_000
ROBUSTNESS_SEED = 40_000
WATCH_SEED = 50_000
CHECK_SEED = 60_000
CYCLE_SEED = 70_000
