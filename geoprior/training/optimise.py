"""One optimiser step: the parts of a batch through the network, and what all processes make of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, cast

import torch

from geoprior.errors import NumericalError
from geoprior.geometry.seeding import integer_seed
from geoprior.policies.halves import takes_half_weights
from geoprior.training.adamw import AdamW, HalfAdamW
from geoprior.training.resume import RESUME_NAME
from geoprior.training.schedule import rate_at

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor, nn

    from geoprior.policies.policy import Batch, Policy
    from geoprior.training.config import TrainConfig
    from geoprior.training.loop import Training
    from geoprior.training.machine import Machine


def make_optimizer(config: TrainConfig, policy: nn.Module, machine: Machine) -> AdamW:
    """AdamW with the trunk in its own group.

    A batch in several parts, which other processes may share, gathers its gradients in float32. Weights are
    lent in bfloat16 to a policy that says that it takes them, see `geoprior.policies.policy.Policy`.
    """
    prefixes = cast("Policy", policy).trunk_prefixes
    trunk: list[nn.Parameter] = []
    rest: list[nn.Parameter] = []
    for name, parameter in policy.named_parameters():
        if parameter.requires_grad:
            (trunk if name.startswith(prefixes) else rest).append(parameter)
    rates = (config.trunk_learning_rate or config.learning_rate, config.learning_rate)
    groups = [
        {"params": parameters, "lr": rate, "full_rate": rate}
        for parameters, rate in zip((trunk, rest), rates, strict=True)
        if parameters
    ]
    lends = machine.device == "cpu" and machine.precision == "bf16" and config.microbatches == 1
    if lends and takes_half_weights(policy):
        return HalfAdamW(groups, config.weight_decay)
    return AdamW(groups, config.weight_decay)


def take_step(
    training: Training, optimizer: AdamW, step: int, parts: Mapping[int, Batch]
) -> dict[str, float]:
    """One optimiser step; its randomness depends on the seed and the numbers of step and part only.

    Args:
        training: The training.
        optimizer: Of the policy's parameters.
        step: Its number, from 0.
        parts: The microbatches of this process, by their numbers.

    Returns:
        The metrics of the whole batch, the same in every process.

    Raises:
        NumericalError: The loss is not finite, in whichever process.
    """
    config, policy = training.config, training.policy
    share = rate_at(config, step, training.steps)
    for group in optimizer.param_groups:
        group["lr"] = group["full_rate"] * share
    optimizer.zero_grad(set_to_none=True)
    statistics = _Statistics(policy, config.microbatches)
    metrics: dict[str, float] = {}
    for number, batch in parts.items():
        statistics.restore()
        with optimizer.lend():
            learned = _learn_part(training, step, number, batch)
        for name, value in learned.items():
            metrics[name] = metrics.get(name, 0.0) + value / config.microbatches
        statistics.add()
    metrics = _shared(training, metrics, statistics)
    statistics.settle()
    if not math.isfinite(metrics["loss"]):
        raise NumericalError(
            f"{training.run}: the loss is {metrics['loss']} at step {step + 1}", remedy(training.folder)
        )
    if config.gradient_clip is not None:
        metrics["gradient_norm"] = optimizer.clip(config.gradient_clip)
    optimizer.step()
    return {**metrics, "learning_rate": config.learning_rate * share}


def remedy(folder: Path) -> str:
    """What to do where numbers stop being finite."""
    kept = f"the last good state is kept in {folder}; " if (folder / RESUME_NAME).exists() else ""
    return f"{kept}lower learning_rate or set gradient_clip"


def _learn_part(training: Training, step: int, number: int, batch: Batch) -> dict[str, float]:
    """Add a part's share to the gradients; returns the part's metrics."""
    microbatches, device = training.config.microbatches, training.machine.device
    key = (step,) if microbatches == 1 else (step, number)
    torch.manual_seed(integer_seed(training.seed, "step", *key))
    batch = cast("Batch", {name: value.to(device) for name, value in batch.items()})  # type: ignore[attr-defined]
    with torch.autocast(device, torch.bfloat16, enabled=training.machine.precision == "bf16"):
        loss, scalars = training.loss(batch)
    (loss / microbatches).backward()  # type: ignore[no-untyped-call]
    return {**{name: float(value) for name, value in scalars.items()}, "loss": loss.item()}


def _shared(training: Training, metrics: dict[str, float], statistics: _Statistics) -> dict[str, float]:
    """Add gradients, statistics and metrics up over the processes."""
    if training.team.size == 1:
        return metrics
    numbers = torch.tensor(list(metrics.values()), dtype=torch.float64)
    training.team.add_up([*_gradients(training.policy), *statistics.sums, numbers])
    return dict(zip(metrics, numbers.tolist(), strict=True))


def _gradients(policy: nn.Module) -> Iterator[Tensor]:
    return (parameter.grad for parameter in policy.parameters() if parameter.grad is not None)


class _Statistics:
    """Running statistics, as those of batch norm: every part begins with the step's, and the mean stays.

    Args:
        policy: Whose buffers they are. Counters, which are integers, end as after one part.
        microbatches: Parts of a batch; with one, nothing is kept and nothing is changed.
    """

    def __init__(self, policy: nn.Module, microbatches: int) -> None:
        self._microbatches = microbatches
        self._all = list(policy.buffers()) if microbatches > 1 else []
        self._begun = [buffer.clone() for buffer in self._all]
        self._means = [buffer for buffer in self._all if buffer.is_floating_point()]
        self._means_begun = [begun for begun in self._begun if begun.is_floating_point()]
        self.sums = [torch.zeros_like(buffer) for buffer in self._means]

    def restore(self) -> None:
        """Before a part."""
        for buffer, begun in zip(self._all, self._begun, strict=True):
            buffer.copy_(begun)

    def add(self) -> None:
        """After a part: what it has changed, so that a constant stays what it is to the last bit."""
        for total, buffer, begun in zip(self.sums, self._means, self._means_begun, strict=True):
            same = buffer == begun  # infinities too, whose difference is no number
            total.add_(torch.where(same, 0.0, buffer - begun), alpha=1.0 / self._microbatches)

    def settle(self) -> None:
        """After the parts of all processes."""
        for total, buffer, begun in zip(self.sums, self._means, self._means_begun, strict=True):
            buffer.copy_(begun + total)
