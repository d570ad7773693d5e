"""What a renderer draws comes through both sources into training and onto sheets: bits, gray and RGB."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from depth_plugin import Depth, DepthConfig, DepthPlugin
from training_material import TINY_ACT

from geoprior.authoring.conformance.suite import OK, examine
from geoprior.cli import cli
from geoprior.errors import DataError, PluginError
from geoprior.executors.local import SerialExecutor
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies.checkpoint import list_checkpoints
from geoprior.shards.manifest import write_manifest
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.verify import info, verify
from geoprior.sources.source import SourceContext
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.generate import generate
from geoprior.synthesis.studio import Studio
from geoprior.training.config import PretrainConfig
from geoprior.training.stages import pretrain
from geoprior.view.subject import staged_subject

SEED = 6
CAMERAS = CamerasConfig(height=32, width=36)
CONFIG = GenerateConfig(
    episodes=2, seconds=1.0, motions=["pick", "push"], primitives=["prism"], episodes_per_shard=2
)
RENDERERS = {"depth": "gray", "solids": "rgb", "points": "binary"}


@pytest.fixture(scope="module", autouse=True)
def depth():
    found = plugins()
    found.register(DepthPlugin(), name="depth", package="outsider", version="1")
    yield
    found._manager.unregister(name="outsider depth")
    del found._registry["renderer", "depth"]
    found._found.pop()


def config(name, **options):
    return CONFIG.model_copy(update={"renderer": Choice(name=name, options=options)})


@pytest.fixture(scope="module", params=list(RENDERERS))
def renderer(request):
    return request.param


@pytest.fixture(scope="module")
def folder(renderer, tmp_path_factory):
    out = tmp_path_factory.mktemp(renderer)
    generate(config(renderer), CAMERAS, seed=SEED, executor=SerialExecutor(), out=out)
    return out


def test_a_depth_renderer_of_somebody_else_keeps_the_contract():
    spec = plugins().spec("renderer", "depth")
    found = [finding for finding in examine(spec) if "explained" not in finding.check]
    assert len(found) > 6
    assert [finding for finding in found if finding.status != OK] == []


def test_shards_are_whole_and_hold_what_was_drawn(renderer, folder):
    assert list(verify(folder)) == []
    assert info(folder)["frames"] == dict.fromkeys(("hand", "third"), RENDERERS[renderer])
    store, studio = EpisodeStore(folder), Studio(config(renderer), CAMERAS, SEED)
    shape = (32, 36, 3) if renderer == "solids" else (32, 36)
    for i, key in enumerate(store.keys):
        motion, _, index = key.rpartition("-")
        episode = studio.episode(Choice(name=motion), int(index))
        for camera in store.cameras:
            frames = store.frames(i, camera, range(10))
            assert frames.shape == (10, *shape)
            np.testing.assert_array_equal(frames, episode.images[camera])
            assert (len(np.unique(frames)) > 2) is (renderer != "points")


def test_other_readers_see_the_same(renderer, folder, tmp_path):
    import tarfile

    store = EpisodeStore(folder)
    with tarfile.open(folder / store.manifest.shards[0].file) as archive:
        data = archive.extractfile("pick-000000.third.000004.png").read()
    seen = cv2.imdecode(np.frombuffer(data, np.uint8), -1)
    seen = seen[..., ::-1] if seen.ndim == 3 else seen
    np.testing.assert_array_equal(seen, store.frames(0, "third", [4])[0])


def test_the_endless_source_draws_the_frames_of_the_shards(renderer, folder):
    context = SourceContext(folder, config(renderer), CAMERAS, SEED, 2**20)
    numbers, steps = np.arange(4), np.array([[0], [3], [6], [9]])
    moments = []
    for name, options in (("shards", {}), ("endless", {"workers": 0})):
        source = plugins().build("source", Choice(name=name, options=options), context)
        moments.append(source.read(numbers, steps))
        source.close()
    for camera in ("hand", "third"):
        np.testing.assert_array_equal(moments[0].frames[camera], moments[1].frames[camera])


def test_a_policy_learns_from_them_through_both_sources(renderer, folder, tmp_path):
    settings = {"epochs": 2, "batch_size": 4, "threads": 1, "precision": "fp32", "log_every": 1}
    logs = []
    for name, options in (("shards", {}), ("endless", {"workers": 0, "keep": 2})):
        source = Choice(name=name, options=options)
        pretrain(
            PretrainConfig(source=source, **settings),
            policy=TINY_ACT,
            seed=SEED,
            data=folder,
            generate=config(renderer),
            cameras=CAMERAS,
            out=tmp_path / name,
        )
        assert list_checkpoints(tmp_path / name)
        logs.append((tmp_path / name / "log.jsonl").read_text())
    assert logs[0] == logs[1], "the same frames are the same training"


def test_sheets_and_films_show_them(renderer, folder, tmp_path):
    sheet, films = tmp_path / "sheet.png", tmp_path / "films"
    for command in (
        ["shards", "preview", str(folder), "--out", str(sheet)],
        ["view", f"{folder}:push-000001", "--out", str(films)],
    ):
        done = CliRunner().invoke(cli, command)
        assert done.exit_code == 0, done.output
    image = cv2.imread(str(sheet))
    frame = EpisodeStore(folder).frames(0, "hand", [0])[0]
    frame = frame[..., ::-1] if frame.ndim == 3 else np.repeat(frame[..., None], 3, axis=2)
    frame = frame.repeat(3, axis=0).repeat(3, axis=1)
    assert cv2.matchTemplate(image, frame, cv2.TM_SQDIFF).min() < 1.0, "the first frame stands on the sheet"
    assert sorted(path.suffix for path in films.iterdir()) == [".png", ".webm"]
    assert staged_subject(Studio(config(renderer), CAMERAS, SEED), "1").episode.images["hand"].any()


def test_kinds_do_not_mix_in_one_folder(renderer, folder, tmp_path):
    other = "solids" if renderer != "solids" else "depth"
    mixed = config(other).model_copy(update={"episodes": 3})
    generate(config(renderer), CAMERAS, seed=SEED, executor=SerialExecutor(), out=tmp_path)
    with pytest.raises(DataError, match="made from another config"):
        generate(mixed, CAMERAS, seed=SEED, executor=SerialExecutor(), out=tmp_path)
    from geoprior.synthesis.generate import make_shard, plan_shards

    tasks = plan_shards(mixed, CAMERAS, SEED, tmp_path)
    first = EpisodeStore(folder).manifest.shards
    write_manifest(tmp_path, [*first, make_shard(tasks[2])])
    with pytest.raises(
        DataError, match=f"disagree on cameras: .*{RENDERERS[renderer]} 32 x 36.* and "
    ) as caught:
        EpisodeStore(tmp_path)
    assert "different folders" in caught.value.hint


class Wrong(Depth):
    """Says gray and draws something else."""

    def render(self, shot):
        return getattr(self, self.fault)(super().render(shot))

    def coloured(self, frames):
        return np.repeat(frames[..., None], 3, axis=-1)

    def deep(self, frames):
        return frames.astype(np.float32)

    def short(self, frames):
        return frames[1:]

    def listed(self, frames):
        return frames.tolist()


@pytest.mark.parametrize(
    ("fault", "found"),
    [
        ("coloured", "uint8 (10, 32, 36, 3)"),
        ("deep", "float32 (10, 32, 36)"),
        ("short", "uint8 (9, 32, 36)"),
        ("listed", "list"),
    ],
)
def test_frames_that_are_not_what_a_renderer_says_are_refused_in_a_sentence(
    tmp_path, monkeypatch, fault, found
):
    monkeypatch.setattr(Wrong, "fault", fault, raising=False)
    key = "renderer", "depth"
    entry = plugins()._registry[key]
    broken = replace(entry, spec=replace(entry.spec, factory=Wrong))
    monkeypatch.setitem(plugins()._registry, key, broken)
    expected = (
        f"renderer 'depth': draws gray frames of 32 x 36 pixels: expected uint8 (10, 32, 36), found {found}"
    )
    with pytest.raises(PluginError) as caught:
        generate(config("depth"), CAMERAS, seed=SEED, executor=SerialExecutor(), out=tmp_path)
    assert caught.value.message == expected
    assert "geoprior plugins check" in caught.value.hint
    assert not list(tmp_path.glob("*.tar"))
    context = SourceContext(tmp_path, config("depth"), CAMERAS, SEED, 2**20)
    source = plugins().build("source", Choice(name="endless", options={"workers": 0}), context)
    with pytest.raises(PluginError) as caught:
        source.read(np.arange(1), np.zeros((1, 1), np.int64))
    source.close()
    assert caught.value.message.startswith("renderer 'depth': draws gray frames of 32 x 36 pixels: expected")


def test_a_renderer_that_does_not_say_what_it_draws_is_refused_before_anything_is_made(tmp_path, monkeypatch):
    monkeypatch.setattr(Depth, "frames", "infrared")
    with pytest.raises(
        PluginError, match="renderer 'depth': its `frames` is 'infrared', expected one of 'binary'"
    ):
        generate(config("depth"), CAMERAS, seed=SEED, executor=SerialExecutor(), out=tmp_path)


def test_black_images_are_black_whatever_is_drawn(renderer):
    black = config(renderer).model_copy(update={"variants": [Choice(name="black-images")]})
    episode = Studio(black, CAMERAS, SEED).episode(Choice(name="push"), 0)
    assert not any(images.any() for images in episode.images.values())
    episode.validate()


def test_options_of_a_renderer_are_part_of_the_recipe():
    far, near = (Studio(config("depth", farthest=at), CAMERAS, SEED) for at in (2.0, 1.0))
    assert far.recipe(Choice(name="pick")) != near.recipe(Choice(name="pick"))
    assert DepthConfig().farthest == 2.0
