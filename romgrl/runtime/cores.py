"""How many cores this process may use: the least of what the machine, its control groups and Slurm give it."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator, MutableMapping
from pathlib import Path, PurePosixPath
from typing import NamedTuple

SLURM = ("SLURM_CPUS_PER_TASK", "SLURM_CPUS_ON_NODE")  # the second is there without --cpus-per-task, too
ALLOWED = "a whole number from 1 on"


class Mount(NamedTuple):
    """Where a hierarchy of control groups is seen, and the group that is seen at its top."""

    place: Path
    top: PurePosixPath
    version: int


def available_cores() -> int:
    """Cores that this process may use, at least 1; a bad value in the environment is told once and left out."""
    return min([affinity(), *quotas(), *granted(os.environ)])


def affinity() -> int:
    """Cores that the process may run on; what PYTHON_CPU_COUNT says where Python reads it (3.13)."""
    if hasattr(os, "process_cpu_count"):
        return os.process_cpu_count() or 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def granted(environment: MutableMapping[str, str]) -> list[int]:
    """What Slurm's variables grant. A bad one is told on stderr and removed: no other process tells it again."""
    found = []
    for name in SLURM:
        value = environment.get(name)
        if value is None:
            continue
        if value.strip().isascii() and value.strip().isdigit() and int(value) > 0:
            found.append(int(value))
        else:
            print(f"warning: {name}={value!r} is not allowed and left out; allowed: {ALLOWED}", file=sys.stderr)
            del environment[name]
    return found


def quotas(process: Path = Path("/proc/self")) -> list[int]:
    """The CPU quotas of the process's control group and of all around it, in cores, rounded up; none: no quota."""
    return [math.ceil(share) for mount, group in groups(process) for share in shares(mount, group)]


def groups(process: Path) -> Iterator[tuple[Mount, PurePosixPath]]:
    """Yield each hierarchy that may limit CPU time with the group of the process in it, as /proc tells them."""
    mounts: dict[int, Mount] = {}
    for mount in read_mounts(process / "mountinfo"):
        mounts.setdefault(mount.version, mount)  # later ones may be those of containers
    for line in read(process / "cgroup").splitlines():
        number, controllers, group = (*line.split(":", 2), "", "")[:3]
        version = 2 if number == "0" and not controllers else 1 if "cpu" in controllers.split(",") else 0
        if version in mounts and group:
            yield mounts[version], PurePosixPath(group)


def read_mounts(path: Path) -> Iterator[Mount]:
    """Yield the mounts of control groups with a CPU controller that a `mountinfo` lists (proc(5))."""
    for line in read(path).splitlines():
        left, _, right = line.partition(" - ")
        place, kind = left.split(" "), right.split(" ")
        if len(place) > 4 and (kind[0] == "cgroup2" or (kind[0] == "cgroup" and "cpu" in kind[-1].split(","))):
            where = place[4].encode().decode("unicode_escape").encode("latin-1").decode(errors="surrogateescape")
            yield Mount(Path(where), PurePosixPath(place[3]), 2 if kind[0] == "cgroup2" else 1)


def shares(mount: Mount, group: PurePosixPath) -> Iterator[float]:
    """Yield the quota, in cores, of a group and of each around it up to the top of what is mounted."""
    inside = group.relative_to(mount.top) if group.is_relative_to(mount.top) else PurePosixPath()
    if ".." in inside.parts:  # in another part of the tree than what this namespace sees
        return
    place = mount.place.joinpath(*(part for part in inside.parts if part != "/"))
    while place.is_relative_to(mount.place):
        if mount.version == 2:
            numbers = read(place / "cpu.max").split()
        else:
            numbers = [read(place / f"cpu.cfs_{name}_us").strip() for name in ("quota", "period")]
        if len(numbers) == 2 and all(each.isdigit() and int(each) > 0 for each in numbers):  # not "max", not -1
            yield int(numbers[0]) / int(numbers[1])
        place = place.parent


def read(path: Path) -> str:
    """The text of a file; nothing where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="surrogateescape")
    except OSError:
        return ""
