import itertools
import json

import pytest

from geoprior.errors import DataError
from geoprior.shards.manifest import (
    MANIFEST,
    Manifest,
    ShardRecord,
    check_length,
    read_manifest,
    record_of,
    write_manifest,
)
from geoprior.shards.writer import write_shard


def record(number, *samples):
    return ShardRecord(
        file=f"s-{number:06d}.tar", bytes=10240, sha256=f"{number:064x}", samples=samples or [f"k{number}"]
    )


def edit(folder, change):
    content = json.loads((folder / MANIFEST).read_text())
    change(content)
    (folder / MANIFEST).write_text(json.dumps(content))


def test_a_manifest_survives_and_the_order_of_records_does_not_matter(tmp_path):
    records = [record(0, "a", "b"), record(1, "c"), record(2, "d")]
    written = []
    for number, order in enumerate(itertools.permutations(records)):
        folder = tmp_path / str(number)
        manifest = write_manifest(folder, order)
        assert read_manifest(folder) == manifest
        written.append((folder / MANIFEST).read_bytes())
    assert len(set(written)) == 1
    assert (manifest.episodes, manifest.bytes, manifest.keys) == (4, 30720, ("a", "b", "c", "d"))


def test_the_digest_follows_content_and_order():
    digests = {
        Manifest(shards=shards).digest
        for shards in ([record(0)], [record(1)], [record(0), record(1)], [record(1), record(0)])
    }
    assert len(digests) == 4
    assert Manifest(shards=[record(0, "x")]).digest == Manifest(shards=[record(0, "y")]).digest


@pytest.mark.parametrize(
    ("records", "fault"),
    [
        ([], "no shards"),
        (
            [record(0, "a"), record(1, "b", "a")],
            r"sample 'a' is listed 2 times \(s-000000.tar, s-000001.tar\)",
        ),
        ([record(0, "a"), record(0, "b")], "file 's-000000.tar' is listed 2 times"),
    ],
)
def test_what_cannot_be_listed_is_refused_and_nothing_is_written(tmp_path, records, fault):
    with pytest.raises(DataError, match=fault):
        write_manifest(tmp_path, records)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_manifest_is_named_with_a_remedy(tmp_path):
    with pytest.raises(DataError, match=r"manifest\.json: no such file") as caught:
        read_manifest(tmp_path)
    assert "geoprior generate" in caught.value.hint
    with pytest.raises(DataError, match="no such file") as caught:
        read_manifest(tmp_path / "nowhere")
    assert "check the path" in caught.value.hint


def test_a_run_folder_names_the_data_sets_in_it(tmp_path):
    write_manifest(tmp_path / "shards" / "synthetic", [record(0)])
    with pytest.raises(DataError) as caught:
        read_manifest(tmp_path)
    assert str(tmp_path / "shards" / "synthetic") in caught.value.hint


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (
            lambda content: content.update(schema_version=2),
            "schema_version is 2, this version of geoprior reads 1",
        ),
        (lambda content: content.pop("schema_version"), "schema_version is None"),
        (lambda content: content.update(more=1), "more: Extra inputs"),
        (lambda content: content.update(shards=[]), "shards: "),
        (lambda content: content["shards"][0].update(file="../s.tar"), r"shards\.0\.file"),
        (lambda content: content["shards"][0].update(file="/etc/s.tar"), r"shards\.0\.file"),
        (lambda content: content["shards"][0].update(sha256="0"), r"shards\.0\.sha256"),
        (lambda content: content["shards"][0].pop("bytes"), r"shards\.0\.bytes: Field required"),
        (lambda content: content["shards"].append(content["shards"][0]), "listed 2 times"),
    ],
)
def test_a_damaged_or_foreign_manifest_is_named_with_the_key(tmp_path, change, fault):
    write_manifest(tmp_path, [record(0), record(1)])
    edit(tmp_path, change)
    with pytest.raises(DataError, match=fault) as caught:
        read_manifest(tmp_path)
    assert str(tmp_path / MANIFEST) in caught.value.message
    assert caught.value.hint


def test_a_manifest_that_is_no_object_or_cut_off_is_named(tmp_path):
    write_manifest(tmp_path, [record(0)])
    text = (tmp_path / MANIFEST).read_text()
    for damaged in ("[]", "", text[: len(text) // 2]):
        (tmp_path / MANIFEST).write_text(damaged)
        with pytest.raises(DataError, match=r"manifest\.json"):
            read_manifest(tmp_path)


def test_the_record_of_a_lone_shard_is_the_writers(tmp_path, make_episode):
    path = tmp_path / "a.tar"
    written = write_shard(path, [make_episode(0), make_episode(1)])
    assert record_of(path) == written
    check_length(path, written)


def test_lengths_are_compared(tmp_path, make_episode):
    path = tmp_path / "a.tar"
    written = write_shard(path, [make_episode()])
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(DataError, match=rf"cut off: {written.bytes - 5} bytes, {written.bytes} are expected"):
        check_length(path, written)
    path.write_bytes(bytes(written.bytes + 1))
    with pytest.raises(DataError, match="too long"):
        check_length(path, written)
    path.unlink()
    with pytest.raises(DataError, match="no such file") as caught:
        check_length(path, written)
    assert "geoprior shards verify" in caught.value.hint
    assert "geoprior generate" in caught.value.hint


def test_an_empty_tar_and_an_odd_name_have_no_record(tmp_path, make_episode):
    (tmp_path / "empty.tar").write_bytes(bytes(10240))
    with pytest.raises(DataError, match="no samples"):
        record_of(tmp_path / "empty.tar")
    write_shard(tmp_path / "a.tar", [make_episode()])
    (tmp_path / "a.tar").rename(tmp_path / "a b.tar")
    for use in (record_of, lambda path: write_shard(path, [make_episode()])):
        with pytest.raises(DataError, match=r"a b\.tar: a shard's name has letters, digits"):
            use(tmp_path / "a b.tar")
