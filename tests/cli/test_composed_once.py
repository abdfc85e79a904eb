"""The jobs of a sweep: their files are composed once, and what comes out is what Hydra alone would give."""

from __future__ import annotations

from typing import Any

import pytest
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.utils import create_config_search_path
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import OmegaConf

from romgrl.cli.allowlist import GuardedLoader
from romgrl.cli.compose import register_schema
from romgrl.cli.config_files import CONF

JOBS = [
    *(["stage=teacher", f"seed={seed}"] for seed in range(5)),
    *(["experiment=smoke", f"seed={seed}", "teacher.speed=${speed}", "hydra.sweep.dir=/tmp/x"] for seed in range(3)),
    *(["experiment=smoke", "student=sac", f"paths.outputs='/a b/{name}'"] for name in ("x=1", "2026_10_05", "3")),
    *(["seed=1", "+tracking.more=1", f"eta={eta}"] for eta in (0.3, 0.5, 0.7)),
]


@pytest.fixture
def loaders() -> tuple[GuardedLoader, ConfigLoaderImpl]:
    """Ours, and Hydra's own."""
    register_schema()
    path = create_config_search_path(str(CONF))
    return GuardedLoader(path), ConfigLoaderImpl(path)


def fresh() -> GuardedLoader:
    """Ours, which has composed nothing yet and so does what Hydra does."""
    return GuardedLoader(create_config_search_path(str(CONF)))


def plain(config: Any) -> Any:
    return OmegaConf.to_container(config, resolve=False)


def test_jobs_are_what_hydra_makes_of_them(loaders: tuple[GuardedLoader, ConfigLoaderImpl]) -> None:
    ours, _ = loaders
    for job in JOBS:
        found, wanted = (loader.load_configuration("config", job, RunMode.RUN) for loader in (ours, fresh()))
        assert plain(found) == plain(wanted)
        assert list(found) == list(wanted)
        assert OmegaConf.is_struct(found) == OmegaConf.is_struct(wanted)
    again = ours.load_configuration("config", JOBS[1], RunMode.RUN)
    assert plain(again) == plain(fresh().load_configuration("config", JOBS[1], RunMode.RUN))  # no job changed another


def test_files_are_read_for_the_first_jobs_only(
    loaders: tuple[GuardedLoader, ConfigLoaderImpl], monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, _ = loaders
    composed: list[list[str]] = []
    whole = ConfigLoaderImpl._load_configuration_impl

    def load(self: ConfigLoaderImpl, config_name: str, overrides: list[str], *rest: Any, **more: Any) -> Any:
        composed.append(overrides)
        return whole(self, config_name, overrides, *rest, **more)

    monkeypatch.setattr(ConfigLoaderImpl, "_load_configuration_impl", load)
    for seed in range(20):
        assert ours.load_configuration("config", [f"seed={seed}"], RunMode.RUN).seed == seed
    assert composed == [["seed=0"], []]


def test_a_fault_of_a_later_job_is_told_as_that_of_the_first(loaders: tuple[GuardedLoader, ConfigLoaderImpl]) -> None:
    for loader in loaders:
        for _ in range(3):
            loader.load_configuration("config", ["seed=1"], RunMode.RUN)
    messages = []
    for loader in loaders:
        with pytest.raises(HydraException) as told:
            loader.load_configuration("config", ["nothing.such=1"], RunMode.RUN)
        messages.append(str(told.value))
    assert messages[0] == messages[1]
    with pytest.raises(HydraException, match="is not allowed"):
        loaders[0].load_configuration("config", ["hydra.launcher._target_=os.system"], RunMode.RUN)
