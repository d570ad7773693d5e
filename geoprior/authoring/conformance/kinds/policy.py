"""A policy: a module that learns chunks of actions for any number of cameras and hands."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from geoprior.authoring.conformance.check import Check, require
from geoprior.hooks.types import PolicySpec
from geoprior.policies.policy import Features, PolicyOptions

if TYPE_CHECKING:
    from geoprior.policies.policy import Batch

BATCH = 3
SIZE = (32, 32)
TRAINING_STEPS = 12


def _features(spec: PolicySpec) -> Iterator[tuple[str, Features]]:
    """What a policy may have to see and say: one hand and its camera, or two."""
    chunk = getattr(spec.config(), "chunk", 25)
    for cameras, hands in ((("hand", "third"), ("hand",)), (("left", "right", "third"), ("left", "right"))):
        yield (
            f"policy {spec.name!r}, {len(cameras)} cameras, {len(hands)} hands",
            Features(cameras, SIZE, hands, chunk),
        )


@contextmanager
def _seeded(seed: int) -> Iterator[None]:
    import torch

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        yield


def _built(spec: PolicySpec, features: Features, seed: int = 0) -> Any:
    with _seeded(seed):
        return spec.factory(spec.config(), features)


def _batch(features: Features, padded: bool = True) -> Batch:  # noqa: FBT001, FBT002
    import torch

    with _seeded(1):
        pose = torch.randn(BATCH, features.pose_size)
        images = torch.randn(BATCH, len(features.cameras), 3, *features.image_size)
        action = pose[:, None] + 0.1 * torch.randn(BATCH, features.chunk, features.pose_size)
    valid = torch.ones(BATCH, features.chunk, dtype=torch.bool)
    if padded and features.chunk > 1:
        valid[0, features.chunk // 2 :] = False
    return {"pose": pose, "images": images, "action": action, "valid": valid}


def options_have_a_chunk(spec: PolicySpec) -> None:
    """The trainer reads `chunk` of every policy's options."""
    require(
        issubclass(spec.config, PolicyOptions),
        f"policy {spec.name!r}: its config model is no PolicyOptions",
        "derive it from geoprior.policies.policy.PolicyOptions",
    )


def is_a_module(spec: PolicySpec) -> None:
    """A `torch.nn.Module` with the features that it was given, and prefixes that name tensors."""
    from torch import nn

    for where, features in _features(spec):
        policy = _built(spec, features)
        require(isinstance(policy, nn.Module), f"{where}: is no torch.nn.Module")
        require(policy.features == features, f"{where}: `features` is not what the factory was given")
        prefixes, names = policy.trunk_prefixes, list(policy.state_dict())
        require(isinstance(prefixes, tuple), f"{where}: `trunk_prefixes` is no tuple but {prefixes!r}")
        for prefix in prefixes:
            require(
                any(name.startswith(prefix) for name in names),
                f"{where}: no tensor's name begins with the trunk prefix {prefix!r}",
                f"names begin for example with {names[0]!r}",
            )


def losses_have_gradients(spec: PolicySpec) -> None:
    """A finite scalar to minimise, detached scalars to log with ``l1`` among them, gradients that reach."""
    import torch

    for where, features in _features(spec):
        policy = _built(spec, features).train()
        with _seeded(2):
            loss, metrics = policy.loss(_batch(features))
        require(loss.ndim == 0 and torch.isfinite(loss), f"{where}: the loss is {loss!r}, no finite scalar")
        require(
            "l1" in metrics, f"{where}: metrics are {sorted(metrics)}", "log `l1`, the mean absolute error"
        )
        for name, value in metrics.items():
            require(
                value.numel() == 1 and not value.requires_grad,
                f"{where}: metric {name!r} is no detached scalar",
                "log value.detach()",
            )
        loss.backward()
        require(
            any(each.grad is not None and bool(each.grad.any()) for each in policy.parameters()),
            f"{where}: no gradient reaches a parameter",
        )


def predictions_are_chunks(spec: PolicySpec) -> None:
    """(B, chunk, pose_size), finite, without gradients, the same again, and without touching torch's dice."""
    import torch

    for where, features in _features(spec):
        policy, batch = _built(spec, features).eval(), _batch(features)
        observation = {"pose": batch["pose"], "images": batch["images"]}
        before = torch.random.get_rng_state()
        first, again = policy.predict(observation), policy.predict(observation)
        shape = (BATCH, features.chunk, features.pose_size)
        require(tuple(first.shape) == shape, f"{where}: predicts {tuple(first.shape)}, expected {shape}")
        require(first.dtype == torch.float32, f"{where}: predicts {first.dtype}, expected torch.float32")
        require(torch.isfinite(first).all(), f"{where}: a prediction is not finite")
        require(not first.requires_grad, f"{where}: a prediction carries gradients", "use torch.no_grad()")
        require(
            torch.equal(first, again),
            f"{where}: predicts something else the second time",
            "prediction has no randomness: fix the latent or the noise",
        )
        require(
            torch.equal(before, torch.random.get_rng_state()),
            f"{where}: predicting draws from torch's global generator",
            "use a torch.Generator of your own",
        )


def rows_do_not_mix(spec: PolicySpec) -> None:
    """A row's prediction is the same alone as in a batch, up to rounding."""
    import torch

    for where, features in _features(spec):
        policy, batch = _built(spec, features).eval(), _batch(features)
        whole = policy.predict({"pose": batch["pose"], "images": batch["images"]})
        alone = policy.predict({"pose": batch["pose"][:1], "images": batch["images"][:1]})
        require(
            torch.allclose(whole[:1], alone, rtol=1e-3, atol=1e-3),
            f"{where}: a row's prediction depends on the other rows of its batch",
            "batch norm must be in evaluation mode, and noise must be of each row",
        )


def weights_are_all_there_is(spec: PolicySpec) -> None:
    """Another object with the same state dict predicts the same: a checkpoint holds nothing else."""
    import torch

    for where, features in _features(spec):
        first, second = _built(spec, features, 0).eval(), _built(spec, features, 5).eval()
        second.load_state_dict(first.state_dict())
        batch = _batch(features)
        observation = {"pose": batch["pose"], "images": batch["images"]}
        require(
            torch.equal(first.predict(observation), second.predict(observation)),
            f"{where}: two objects with the same state dict predict differently",
            "keep all that decides a prediction in parameters and buffers",
        )
        require(
            all(
                map(torch.equal, first.state_dict().values(), _built(spec, features, 0).state_dict().values())
            ),
            f"{where}: torch.manual_seed does not decide the first weights",
        )


def it_learns(spec: PolicySpec) -> None:
    """Some steps of AdamW on one batch lower the loss."""
    import torch

    where, features = next(iter(_features(spec)))
    policy, batch = _built(spec, features).train(), _batch(features, padded=False)
    optimizer = torch.optim.AdamW(policy.parameters(), lr=1e-3)
    losses = []
    with _seeded(3):
        for _ in range(TRAINING_STEPS):
            optimizer.zero_grad()
            loss, _metrics = policy.loss(batch)
            loss.backward()
            optimizer.step()
            losses.append(float(loss.detach()))
    early, late = sum(losses[:3]), sum(losses[-3:])
    require(
        late < early,
        f"{where}: {len(losses)} steps on one batch: the loss goes from {losses[0]:.3g} to {losses[-1]:.3g}",
    )


CHECKS = (
    Check("its options have a chunk", options_have_a_chunk),
    Check("it is a module of torch", is_a_module),
    Check("its loss has gradients", losses_have_gradients),
    Check("its predictions are chunks of actions", predictions_are_chunks),
    Check("the rows of a batch do not mix", rows_do_not_mix),
    Check("its weights are all there is to it", weights_are_all_there_is),
    Check("it learns", it_learns, slow=True),
)
