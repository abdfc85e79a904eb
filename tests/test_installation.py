"""The package installs on other people's machines: what is installed, in which way, from which files."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NAME = re.compile(r"[A-Za-z0-9_.-]+")


def requirements(*extras: str) -> list[str]:
    """What .ci/requirements.py prints."""
    command = [sys.executable, str(ROOT / ".ci" / "requirements.py"), *extras]
    return subprocess.run(command, check=True, capture_output=True, text=True, encoding="utf-8").stdout.splitlines()


def pinned() -> dict[str, str]:
    """Versions of constraints.txt by normalised name."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pairs = [line.split("==") for line in lines if line and not line.startswith("#")]
    return {normalised(name): version for name, version in pairs}


def normalised(requirement: str) -> str:
    """The name of a requirement as package indexes compare it."""
    found = NAME.match(requirement)
    assert found is not None, requirement
    return re.sub(r"[-_.]+", "-", found[0]).lower()


def planned(target: str, *arguments: str, directory: Path = ROOT) -> str:
    """The commands that make would run."""
    command = ["make", "--dry-run", "--no-print-directory", target, *arguments]
    made = subprocess.run(command, cwd=directory, check=True, capture_output=True, text=True, encoding="utf-8")
    return made.stdout


def test_every_requirement_is_listed_and_pinned() -> None:
    listed = requirements("dev")
    assert set(PROJECT["dependencies"]) < set(listed)
    assert {"pytest", "hydra-joblib-launcher>=1.2", "scikit-build-core>=0.11"} < set(listed)
    assert not any(line.startswith("romgrl") for line in listed)
    assert not [line for line in listed if normalised(line) not in pinned()]


def test_what_builds_others_is_pinned_too() -> None:
    assert {"setuptools", "wheel"} <= pinned().keys()


def test_only_the_package_itself_is_built_without_isolation(tmp_path: Path) -> None:
    pips = [line for line in planned("install", f"VENV={tmp_path}/venv").splitlines() if "pip install" in line]
    assert len(pips) == 2
    libraries, package = pips
    assert "--no-build-isolation" not in libraries
    assert "--no-build-isolation" in package
    assert "--no-deps" in package


def test_each_step_of_the_installation_says_what_it_does(tmp_path: Path) -> None:
    said = re.findall(r'echo "(\d)/(\d) ', planned("install", f"VENV={tmp_path}/venv"))
    assert said == [(str(step), "4") for step in range(1, 5)]


def test_a_step_that_fails_is_named_on_the_last_line(tmp_path: Path) -> None:
    command = ["make", "--no-print-directory", "install", f"VENV={tmp_path}/venv", "PYTHON=false"]
    shutil.copytree(ROOT / ".ci", tmp_path / ".ci")
    shutil.copy(ROOT / "Makefile", tmp_path)
    (tmp_path / ".ci" / "system-packages").write_text("#!/bin/sh\n", encoding="utf-8")
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, encoding="utf-8", check=False)
    said = [line for line in ended.stderr.splitlines() if "***" not in line]
    assert ended.returncode != 0
    assert said[-1].startswith("make: the virtual environment failed: ")


def test_the_directory_of_the_clone_may_have_a_blank(tmp_path: Path) -> None:
    clone = tmp_path / "my clone"
    clone.mkdir()
    shutil.copy(ROOT / "Makefile", clone)
    (clone / "constraints.txt").touch()
    (clone / "print.mk").write_text(
        'include Makefile\nshow:\n\t@echo "$$PIP_CONSTRAINT"\n\t@test -f "$$PIP_CONSTRAINT"\n', encoding="utf-8"
    )
    command = ["make", "--no-print-directory", "-f", "print.mk", "show"]
    shown = subprocess.run(command, cwd=clone, check=True, capture_output=True, text=True, encoding="utf-8").stdout
    assert shown.split() == [shown.strip()]


def test_the_python_that_runs_this_is_one_of_those_that_are_named() -> None:
    assert f"Programming Language :: Python :: {sys.version_info[0]}.{sys.version_info[1]}" in PROJECT["classifiers"]


@pytest.mark.slow
def test_sdist_and_wheel_run_in_any_directory(tmp_path: Path) -> None:
    """The sdist builds a wheel, which runs what ships with it, in a directory with nothing of the checkout."""
    build = "from scikit_build_core.build import build_sdist; import sys; print(build_sdist(sys.argv[1]))"
    subprocess.run([sys.executable, "-c", build, str(tmp_path)], cwd=ROOT, check=True, capture_output=True)
    (sdist,) = tmp_path.glob("romgrl-*.tar.gz")
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "-w", str(tmp_path)]
    free = {name: value for name, value in os.environ.items() if not name.startswith("PIP_")}  # of make's constraints
    subprocess.run([*pip, str(sdist)], cwd=tmp_path, env=free, check=True)
    (wheel,) = tmp_path.glob("romgrl-*.whl")
    site = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(site)
    environment = os.environ | {"PYTHONPATH": f"{site}:{sysconfig.get_path('purelib')}", "OMP_NUM_THREADS": "1"}
    python = [sys.executable, "-S", "-m", "romgrl"]  # without the checkout, which is installed as editable
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()

    def run(*arguments: str) -> str:
        done = subprocess.run(
            [*python, *arguments], cwd=elsewhere, env=environment, capture_output=True, text=True, encoding="utf-8"
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "python -m romgrl" in run("--help")
    small = ["stage=evaluation", "evaluation.episodes=2", "evaluation.steps=100", "tracking.enabled=false"]
    assert "Error against the reference" in run("student=pretrained", *small)
    (manifest,) = elsewhere.glob("outputs/artifacts/evaluation/*/manifest.json")
    assert f'"romgrl": "{PROJECT["version"]}"' in manifest.read_text(encoding="utf-8")
