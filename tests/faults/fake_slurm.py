"""As much of Slurm as submitit uses, for one machine: sbatch with arrays, srun, sacct, scontrol requeue.

`install` puts commands into a directory that are this file; what they share lies beside them.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

COMMANDS = ("sbatch", "srun", "sacct", "scontrol", "scancel")
JOB = 7000
CPUS = re.compile(r"--cpus-per-task=(\d+)")
ARRAY = re.compile(r"--array=0-(\d+)%")


def install(directory: Path) -> None:
    """Make the commands."""
    directory.mkdir()
    for name in COMMANDS:
        path = directory / name
        path.write_text(
            f'#!/bin/sh\nexec {sys.executable} {Path(__file__).resolve()} {directory} {name} "$@"\n', encoding="utf-8"
        )
        path.chmod(0o755)


def sbatch(state: Path, script: str) -> None:
    """Queue a script, once or once for each task of its array."""
    text = Path(script).read_text(encoding="utf-8")
    (state / "script.sh").write_text(text, encoding="utf-8")
    array, cpus = ARRAY.search(text), CPUS.search(text)
    assert cpus is not None
    for task in range(int(array[1]) + 1) if array else [None]:
        variables = {"SLURM_JOB_ID": str(JOB + 1 + (task or 0)), "SLURM_CPUS_PER_TASK": cpus[1]}
        if task is not None:
            variables |= {"SLURM_ARRAY_JOB_ID": str(JOB), "SLURM_ARRAY_TASK_ID": str(task)}
        else:
            variables["SLURM_JOB_ID"] = str(JOB)
        with (state / "slurm.log").open("a", encoding="utf-8") as log:
            subprocess.Popen(
                [sys.executable, __file__, str(state), "run"],
                env=os.environ | variables,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
    print(f"Submitted batch job {JOB}")


def name_of_job() -> str:
    """`7000`, or `7000_1` in an array."""
    array = os.environ.get("SLURM_ARRAY_JOB_ID")
    return f"{array}_{os.environ['SLURM_ARRAY_TASK_ID']}" if array else os.environ["SLURM_JOB_ID"]


def run(state: Path) -> None:
    """Run a job, and again for as long as it is queued again."""
    requeued = state / f"{name_of_job()}.requeued"
    while True:
        requeued.unlink(missing_ok=True)
        subprocess.run(["bash", state / "script.sh"], check=False)
        if not requeued.exists():
            (state / f"{name_of_job()}.completed").touch()
            return


def srun(arguments: list[str]) -> None:
    """Be the one task of a job."""
    options, command = arguments[:5], arguments[5:]
    assert (options[0], options[1], options[3]) == ("--unbuffered", "--output", "--error")
    array, task = os.environ.get("SLURM_ARRAY_JOB_ID", ""), os.environ.get("SLURM_ARRAY_TASK_ID", "")
    for stream, pattern in ((1, options[2]), (2, options[4])):
        path = pattern.replace("%A", array).replace("%a", task).replace("%t", "0").replace("%j", name_of_job())
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND), stream)
    os.environ.update({"SLURM_NTASKS": "1", "SLURM_PROCID": "0", "SLURM_LOCALID": "0", "SLURM_NODEID": "0"})
    os.execvp(command[0], command)


def sacct(state: Path) -> None:
    """Print the states of all jobs."""
    print("JobID|State|NodeList")
    for path in state.glob("*.completed"):
        print(f"{path.stem}|COMPLETED|localhost")


def main() -> None:
    """One of the commands."""
    state, name, *arguments = sys.argv[1:]
    if name == "sbatch":
        sbatch(Path(state), *arguments)
    elif name == "srun":
        srun(arguments)
    elif name == "run":
        run(Path(state))
    elif name == "sacct":
        sacct(Path(state))
    elif name == "scontrol":
        assert arguments[0] == "requeue"
        Path(state, f"{arguments[1]}.requeued").touch()


if __name__ == "__main__":
    main()
