"""What is used of Hydra without its promise is there as it was used; each case is what breaks without it."""

from __future__ import annotations

import inspect
from importlib.metadata import requires
from typing import Any

import hydra._internal.defaults_list as defaults_list
import hydra._internal.hydra as engine
import pytest
from hydra.plugins.sweeper import Sweeper

from romgrl.cli import hydra_internals
from romgrl.cli.allowlist import GuardedLoader, LoudCallbacks, guard_hydra
from romgrl.cli.config_files import FileConfigSource

USED = {
    "command lines are checked before Hydra reads them": (hydra_internals.get_args_parser, []),
    "the directories of the options are searched": (hydra_internals.create_config_search_path, ["search_path_dir"]),
    "nothing foreign is made; jobs are composed once": (
        hydra_internals.ConfigLoaderImpl.load_configuration,
        ["config_name", "overrides", "run_mode", "from_shell", "validate_sweep_overrides"],
    ),
    "jobs are composed once": (
        hydra_internals.ConfigLoaderImpl._apply_overrides_to_config,
        ["overrides", "cfg"],
    ),
    "titles of jobs": (
        hydra_internals.get_overrides_dirname,
        ["overrides", "exclude_keys", "item_sep", "kv_sep"],
    ),
    "a callback that fails is an exit code": (
        hydra_internals.Callbacks._notify,
        ["function_name", "reverse", "kwargs"],
    ),
    "text in files is what was typed": (hydra_internals.FileConfigSource.load_config, ["config_path"]),
    "all jobs of a sweep are checked before the first starts": (
        hydra_internals.BasicSweeper.split_arguments,
        ["overrides", "max_batch_size"],
    ),
    "the files of a circle of defaults are named": (
        defaults_list._create_defaults_tree_impl,
        ["repo", "root", "is_root_config", "skip_missing", "interpolated_subtree", "overrides"],
    ),
    "jobs are composed twice, not three times": (Sweeper.validate_batch_is_legal, ["batch"]),
}


@pytest.mark.parametrize("what", USED)
def test_it_takes_what_it_took(what: str) -> None:
    function, expected = USED[what]
    found = [name for name in inspect.signature(function).parameters if name not in ("self", "sweeper")]
    assert found == expected, f"broken by this version of Hydra: {what}"


def test_hydra_comes_to_our_classes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The names that are replaced are those that Hydra looks up."""
    own: Any = engine
    guard_hydra()
    assert (own.ConfigLoaderImpl, own.Callbacks) == (GuardedLoader, LoudCallbacks)
    source = inspect.getsource(engine.Hydra)
    assert "ConfigLoaderImpl(" in source
    assert "Callbacks(" in source
    assert issubclass(FileConfigSource, hydra_internals.FileConfigSource)


def test_the_version_is_bounded() -> None:
    assert "hydra-core<1.4,>=1.3" in [text.replace(" ", "") for text in requires("romgrl") or ()]
