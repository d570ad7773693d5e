"""What the trainer and the rollouts may rely on, and what makes it a diffusion policy."""

import subprocess
import sys

import pytest
import torch
from geoprior_diffusion import plugin
from geoprior_diffusion.average import Average
from geoprior_diffusion.noise import Noise
from geoprior_diffusion.plugin import DiffusionConfig, geoprior_policies
from geoprior_diffusion.policy import DiffusionPolicy
from pydantic import ValidationError

from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies.checkpoint import load_checkpoint, load_weights
from geoprior.policies.policy import Features
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.generate import generate
from geoprior.training.config import PretrainConfig
from geoprior.training.stages import pretrain

FEATURES = Features(cameras=("hand", "third"), image_size=(40, 64), hands=("hand",), chunk=5)
SIZES = {"widths": (8, 16), "keypoints": 4, "level_features": 8, "trunk_width": 8, "train_steps": 20}
PREDICTIONS = ("epsilon", "sample", "v_prediction")


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    """Networks of this size wait for a second thread longer than it saves."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def make_policy(seed=0, features=FEATURES, **options):
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        config = DiffusionConfig(chunk=features.chunk, **{**SIZES, **options})
        return DiffusionPolicy(config, features)


def make_batch(size=3, features=FEATURES):
    rng = torch.Generator().manual_seed(5)
    shape = (size, len(features.cameras), 3, *features.image_size)
    lengths = torch.tensor([features.chunk, 2, 1] * size)[:size, None]
    return {
        "pose": torch.randn(size, features.pose_size, generator=rng),
        "images": torch.randn(shape, generator=rng),
        "action": torch.randn(size, features.chunk, features.pose_size, generator=rng),
        "valid": torch.arange(features.chunk) < lengths,
    }


def seeded_loss(policy, batch):
    torch.manual_seed(7)
    return policy.loss(batch)


def test_registering_it_imports_nothing_heavy():
    code = "import sys, geoprior_diffusion.plugin; sys.exit(bool({'torch', 'diffusers'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(("chunk", "widths"), [(1, (8,)), (1, (8, 8, 16)), (9, (8, 16)), (25, (8, 8, 8, 8))])
def test_a_chunk_of_any_length_goes_through_any_strides(chunk, widths):
    features = Features(cameras=("a", "b", "c"), image_size=(33, 70), hands=("left", "right"), chunk=chunk)
    policy, batch = make_policy(features=features, widths=widths), make_batch(2, features)
    assert policy.predict(batch).shape == (2, chunk, 16)
    loss, scalars = policy.loss(batch)
    assert loss.shape == ()
    assert set(scalars) == {"loss", "l1"}
    assert not any(scalar.requires_grad for scalar in scalars.values())


@pytest.mark.parametrize("training", [True, False])
def test_the_loss_does_not_see_padded_actions(training):
    policy, batch = make_policy().train(training), make_batch()
    before, scalars = seeded_loss(policy, batch)
    batch["action"] = torch.where(batch["valid"].unsqueeze(-1), batch["action"], torch.tensor(99.0))
    after, others = seeded_loss(policy, batch)
    assert torch.equal(after, before)
    assert {name: value.item() for name, value in others.items()} == {
        name: value.item() for name, value in scalars.items()
    }
    batch["action"][0, 0] += 1.0
    assert not torch.isclose(seeded_loss(policy, batch)[0], before)


@pytest.mark.parametrize("training", [True, False])
@pytest.mark.parametrize("norm", ["group", "batch"])
def test_a_prediction_depends_on_its_own_observation_alone(training, norm):
    policy, batch = make_policy(trunk_norm=norm).train(training), make_batch()
    torch.manual_seed(1)
    predicted = policy.predict(batch)
    assert not predicted.requires_grad
    torch.manual_seed(2)
    assert torch.equal(policy.predict(batch), predicted)
    observed = {name: batch[name] for name in ("pose", "images")}
    alone = policy.predict({name: rows[1:2] for name, rows in observed.items()})
    torch.testing.assert_close(alone, predicted[1:2], atol=1e-5, rtol=1e-4)
    others = {name: torch.cat([rows[1:2], torch.randn_like(rows)]) for name, rows in observed.items()}
    torch.testing.assert_close(policy.predict(others)[:1], predicted[1:2], atol=1e-5, rtol=1e-4)
    assert not torch.allclose(predicted[0], predicted[1], atol=1e-3)


def test_every_row_starts_from_the_same_noise_in_every_policy():
    assert torch.equal(make_policy(seed=0)._start, make_policy(seed=1)._start)


@pytest.mark.parametrize("inference_steps", [1, 7, 20])
@pytest.mark.parametrize("prediction", PREDICTIONS)
def test_sampling_finds_the_actions_of_a_network_that_knows_them(prediction, inference_steps):
    noise = Noise(DiffusionConfig(prediction=prediction, train_steps=20, inference_steps=inference_steps))
    torch.manual_seed(0)
    actions = torch.randn(4, 6, 8).double()

    def all_knowing(noisy, levels):
        kept = noise._scheduler.alphas_cumprod[levels][:, None, None].double()
        hidden = (noisy - kept.sqrt() * actions) / (1.0 - kept).sqrt()
        return noise.target(actions, hidden, levels)

    found = noise.denoise(torch.randn_like(actions), all_knowing)
    torch.testing.assert_close(found, actions, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("prediction", PREDICTIONS)
def test_what_shall_be_said_reveals_the_actions_and_l1_is_their_error(prediction):
    noise = Noise(DiffusionConfig(prediction=prediction, clip=3.0))
    torch.manual_seed(0)
    actions = torch.randn(50, 6, 8).clamp(-3.0, 3.0).double()
    hidden, levels = torch.randn_like(actions), torch.arange(50)
    noisy = noise.hide(actions, hidden, levels)
    said = noise.target(actions, hidden, levels)
    torch.testing.assert_close(noise.reveal(noisy, said, levels), actions, atol=1e-5, rtol=1e-5)
    assert noise.reveal(noisy, 1e6 * said, levels).abs().max() == 3.0


def test_the_average_forgets_the_first_weights_and_then_lags_by_what_the_decay_says():
    network = torch.nn.Linear(1, 1)
    average = Average(network, 0.9)
    history = []
    for step in range(120):
        with torch.no_grad():
            network.weight.fill_(float(step))
        average.follow(network)
        history.append(average.network.weight.item())
    assert history[0] == 0.0
    assert history[8] > 0.0
    assert history[-1] == pytest.approx(119.0 - 9.0, abs=0.1)  # a tenth of the way to each next number


def test_what_acts_is_the_average_and_what_learns_is_the_network():
    policy, batch = make_policy(average=0.9), make_batch()
    assert set(policy.average.network.state_dict()) == set(policy.network.state_dict())
    before = policy.predict(batch)
    with torch.no_grad():
        for weight in policy.network.parameters():
            weight.add_(0.1)
    assert torch.equal(policy.predict(batch), before)
    policy.eval().loss(batch)
    assert torch.equal(policy.predict(batch), before)
    policy.train().loss(batch)
    assert not torch.allclose(policy.predict(batch), before)


def test_without_averaging_the_last_weights_act():
    network = torch.nn.Linear(2, 2)
    average = Average(network, 0.0)
    for _ in range(3):
        torch.nn.init.normal_(network.weight)
        average.follow(network)
        assert torch.equal(average.network.weight, network.weight)


def test_the_optimiser_sees_the_network_and_every_weight_of_it_learns():
    policy, batch = make_policy().train(), make_batch()
    policy.loss(batch)[0].backward()
    assert all(name.startswith("network.") for name, _ in policy.named_parameters())
    still = [n for n, weight in policy.named_parameters() if weight.grad is None or not weight.grad.any()]
    assert still == []


def test_the_trunk_is_that_of_act():
    policy = make_policy()
    act = plugins().build("policy", Choice(name="act", options={"chunk": 5, "trunk_width": 8}), FEATURES)

    def trunk(of):
        (prefix,) = of.trunk_prefixes
        return {
            name.removeprefix(prefix): tensor.shape
            for name, tensor in of.state_dict().items()
            if name.startswith(prefix)
        }

    grouped = {name: shape for name, shape in trunk(act).items() if name in trunk(policy)}
    assert trunk(policy) == grouped
    assert trunk(make_policy(trunk_norm="batch")) == trunk(act)


def test_it_learns_a_batch_by_heart():
    """Frames that say which of two ways to go: the sampled actions follow the frames."""
    features = Features(cameras=("third",), image_size=(32, 32), hands=("hand",), chunk=4)
    policy = make_policy(features=features, widths=(16, 32), average=0.5).train()
    images = torch.zeros(2, 1, 3, 32, 32)
    images[0, ..., :16], images[1, ..., 16:] = 2.0, 2.0
    ways = torch.tensor([-1.0, 1.0])[:, None, None] * torch.linspace(0.2, 1.5, 4)[None, :, None]
    batch = {
        "pose": torch.zeros(2, 8),
        "images": images,
        "action": ways.expand(2, 4, 8),
        "valid": torch.ones(2, 4, dtype=torch.bool),
    }
    optimizer = torch.optim.AdamW(policy.parameters(), lr=3e-3)
    torch.manual_seed(0)
    for _ in range(60):
        optimizer.zero_grad()
        policy.loss(batch)[0].backward()
        optimizer.step()
    sampled = policy.eval().loss(batch)[1]["sampled_l1"]
    torch.testing.assert_close(sampled, (policy.predict(batch) - batch["action"]).abs().mean())
    assert sampled < 0.25


def test_bf16_stays_near_fp32():
    policy, batch = make_policy().eval(), make_batch()
    with torch.autocast("cpu", torch.bfloat16):
        low, _ = seeded_loss(policy, batch)
    high, _ = seeded_loss(policy, batch)
    assert low.dtype == torch.float32
    torch.testing.assert_close(low, high, rtol=0.05, atol=0.05)


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"inference_steps": 101}, "inference_steps 101 exceeds train_steps 100"),
        ({"kernel": 4}, "kernel 4 must be odd"),
        ({"widths": (12,)}, "multiple of 8"),
        ({"widths": ()}, "at least 1"),
        ({"prediction": "score"}, "'epsilon', 'sample' or 'v_prediction'"),
        ({"average": 1.0}, "less than 1"),
    ],
)
def test_options_are_checked_at_the_door(options, fault):
    with pytest.raises(ValidationError, match=fault):
        DiffusionConfig(**options)


@pytest.fixture(scope="module")
def trainings(tmp_path_factory):
    """Checkpoints of trainings of three steps: the second in two parts a batch, the third in bfloat16."""
    folder = tmp_path_factory.mktemp("run")
    cameras = CamerasConfig(height=32, width=32)
    data = GenerateConfig(episodes=4, motions=[Choice(name="pick")], seconds=1)
    generate(data, cameras, seed=0, executor=plugins().build("executor", Choice(name="serial")), out=folder)
    if "diffusion" not in plugins().names("policy"):  # on the path and not installed
        plugins().register(plugin, name="diffusion", package="geoprior-diffusion", version="0")
    checkpoints = []
    for microbatches, precision in ((1, "fp32"), (2, "fp32"), (1, "bf16")):
        config = PretrainConfig(
            epochs=3, batch_size=4, microbatches=microbatches, precision=precision, threads=1
        )
        out = folder / f"in-{microbatches}-{precision}"
        policy = Choice(name="diffusion", options={"chunk": 5, **SIZES})
        pretrain(config, policy=policy, seed=0, data=folder, generate=data, cameras=cameras, out=out)
        checkpoints.append(out / "epoch-000003.safetensors")
    return checkpoints


def test_the_average_moves_once_a_step_in_however_many_parts_a_batch_is_learned(trainings):
    assert [int(load_checkpoint(path)[1]["average.updates"]) for path in trainings] == [3, 3, 3]


def test_in_bfloat16_the_average_is_that_of_the_rounded_weights(trainings):
    whole, half = (load_checkpoint(trainings[number])[1] for number in (0, 2))
    assert {tensor.dtype for tensor in half.values()} == {torch.float32, torch.int64}
    for name, tensor in half.items():
        if name.startswith("average.network."):
            torch.testing.assert_close(tensor, whole[name], atol=2e-3, rtol=2e-2)


def test_with_the_trunk_only_the_average_begins_anew(trainings):
    header, tensors = load_checkpoint(trainings[0])
    policy = make_policy(seed=9, features=header.features)
    names = load_weights(policy, trainings[0], "trunk")
    assert names
    assert all(name.startswith("network.trunk.") for name in names)
    policy.train().loss(make_batch(features=header.features))
    acting = policy.average.network.state_dict()["trunk.conv1.weight"]
    assert torch.equal(acting, tensors["network.trunk.conv1.weight"])


def test_it_is_one_policy():
    (spec,) = geoprior_policies()
    assert (spec.name, spec.config) == ("diffusion", DiffusionConfig)
