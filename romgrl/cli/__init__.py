"""All that happens before a job runs: arguments, composition, checks, help, exit codes."""
