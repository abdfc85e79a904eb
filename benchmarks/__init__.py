"""Speed of physics and learners on this machine: `python -m benchmarks [NAME ...]`."""
