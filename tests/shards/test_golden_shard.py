import re
import tarfile
import zlib
from pathlib import Path

import pytest

from geoprior.episode import CameraHeader, EpisodeHeader
from geoprior.shards.golden import FILE, ZLIB, golden_episodes, write_golden
from geoprior.shards.manifest import Manifest, ShardRecord, read_manifest
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.verify import verify

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "shards" / "golden"
README = (ROOT / "shards" / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


def test_the_golden_shard_is_whole_and_small():
    assert list(verify(GOLDEN)) == []
    assert (GOLDEN / FILE).stat().st_size <= 20480


def test_the_golden_shard_holds_the_golden_episodes(same):
    store = EpisodeStore(GOLDEN)
    assert store.keys == ("pick-000000", "push-000001")
    for i, episode in enumerate(golden_episodes()):
        same(store.episode(i), episode)


def test_todays_writer_gives_the_same_members_and_content(tmp_path, same):
    write_golden(tmp_path)
    with tarfile.open(tmp_path / FILE) as ours, tarfile.open(GOLDEN / FILE) as kept:
        for name in ("name", "mode", "uid", "gid", "uname", "gname", "mtime", "type"):
            assert [getattr(m, name) for m in ours] == [getattr(m, name) for m in kept]
        for name in kept.getnames():
            if ".third." not in name:
                assert ours.extractfile(name).read() == kept.extractfile(name).read()
    for i in range(2):
        same(EpisodeStore(tmp_path).episode(i), EpisodeStore(GOLDEN).episode(i))


@pytest.mark.skipif(zlib.ZLIB_RUNTIME_VERSION != ZLIB, reason=f"the golden bytes are those of zlib {ZLIB}")
def test_todays_writer_gives_the_same_bytes(tmp_path):
    write_golden(tmp_path)
    assert (tmp_path / FILE).read_bytes() == (GOLDEN / FILE).read_bytes()
    assert read_manifest(tmp_path) == read_manifest(GOLDEN)


def test_the_readmes_reader_is_ten_lines_and_reads_the_golden_shard(run_python, monkeypatch):
    monkeypatch.chdir(ROOT)
    code = BLOCKS[0]
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    assert "geoprior" not in code
    assert run_python(code).splitlines() == [
        f"{key} (3, 8) (3, 8) {camera}"
        for key in ("pick-000000", "push-000001")
        for camera in ("hand (3, 16, 16)", "third (3, 16, 16, 3)")
    ]


def test_the_readmes_other_examples_run(monkeypatch):
    monkeypatch.chdir(ROOT)
    names = {}
    exec(compile(BLOCKS[1], "README.md", "exec"), names)
    assert names["frames"].shape == (2, 16, 16, 3)
    assert len(BLOCKS) == 2


@pytest.mark.parametrize("model", [EpisodeHeader, CameraHeader, Manifest, ShardRecord])
def test_the_readme_tells_every_field(model):
    for field in model.model_fields:
        assert re.search(rf"^\|.*`{field}`.*\|.*\|$", README, flags=re.MULTILINE), field
