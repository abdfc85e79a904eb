"""What is older than a key counts where the key says what held before it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from romgrl.artifacts import read_manifest
from romgrl.config.schema import Config
from romgrl.results.evaluation_index import select
from tests.results.chains import changed, finish


def test_what_was_made_before_a_key_counts_where_it_says_the_same(default_config: Config, tmp_path: Path) -> None:
    finish(tmp_path, changed(default_config, "seed=5"))
    for path in tmp_path.glob("artifacts/*/*/manifest.json"):
        manifest = read_manifest(path.parent)
        older = {key: value for key, value in manifest.config.items() if key != "teacher.speeds"}
        path.write_text(replace(manifest, config=older).text, encoding="utf-8")
    ranging = changed(default_config)
    assert select(tmp_path, ranging).seeds == [5]
    ranging.teacher.speeds = [1.0, 5.0]
    (reason,) = select(tmp_path, ranging).left_out.values()
    assert "made before teacher.speeds was a key" in reason
