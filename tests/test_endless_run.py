"""Fresh episodes through the pipeline, in the smallest sizes."""

import json

import pytest

from geoprior.config import load_config
from geoprior.errors import ConfigError
from geoprior.files import sha256_file
from geoprior.hooks.manager import plugins
from geoprior.pipeline import run_stages
from geoprior.run_folder import open_run
from geoprior.stages import STAGES

ENDLESS = "pretrain.source=endless"


def run(path, config_file, *overrides, replace=False):
    """Generation and pretraining; returns what was said and the last checkpoint's header."""
    small = ["executor=serial", "pretrain.epochs=2", "pretrain.threads=1"]
    config = load_config(config_file, [*small, *overrides], plugins())
    said = []
    with open_run(path, config, STAGES, replace=replace) as folder:
        run_stages(folder, ("generate", "pretrain"), plugins(), said.append)
    return said, json.loads((path / "checkpoints/pretrain/epoch-000002.json").read_text())


def test_a_run_pretrains_on_fresh_episodes_and_its_files_say_so(tiny_config, tmp_path):
    _, recorded = run(tmp_path, tiny_config)
    before = sha256_file(tmp_path / "shards/synthetic/manifest.json")
    with pytest.raises(ConfigError, match=r"pretrain.source.name: 'shards' -> 'endless'"):
        run(tmp_path, tiny_config, ENDLESS)
    said, fresh = run(tmp_path, tiny_config, ENDLESS, replace=True)
    assert said == ["generate: done before, skipped"]
    assert sha256_file(tmp_path / "shards/synthetic/manifest.json") == before
    assert fresh["details"]["data"]["episodes"] == recorded["details"]["data"]["episodes"] == 12
    assert fresh["details"]["data"]["digest"] != recorded["details"]["data"]["digest"]
    source = json.loads((tmp_path / "stages/pretrain.json").read_text())["config"]["pretrain"]["source"]
    assert source == {"name": "endless", "episodes": None, "keep": 8}
    for more in ([], ["pretrain.frame_cache_mb=9", "pretrain.source={name: endless, workers: 0}"]):
        assert run(tmp_path, tiny_config, ENDLESS, *more)[0] == [
            "generate: done before, skipped",
            "pretrain: done before, skipped",
        ]


@pytest.mark.parametrize(
    "change", ["seed=9", "cameras.height=48", "generate.seconds=3", "generate.primitives=[cone]"]
)
def test_pretraining_depends_on_all_that_its_episodes_are_made_from(tiny_config, change):
    """On the config itself: the digest of the shards tells of their own episodes only."""
    (pretrain,) = (stage for stage in STAGES if stage.name == "pretrain")
    before, after = (load_config(tiny_config, [ENDLESS, *more], plugins()) for more in ([], [change]))
    assert pretrain.config(before) != pretrain.config(after)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("pretrain.source=endles", "key 'pretrain.source': unknown source 'endles'"),
        ("pretrain.source={name: endless, keep: 0}", "source 'endless': option 'keep'"),
        ("pretrain.source={name: shards, keep: 2}", "source 'shards': option 'keep'"),
    ],
)
def test_a_wrong_source_is_refused_before_anything_runs(tiny_config, override, said):
    with pytest.raises(ConfigError, match=said):
        load_config(tiny_config, [override], plugins())
