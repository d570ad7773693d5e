"""AdamW, and a form of it for training in bfloat16 on a CPU."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from geoprior.policies.halves import is_large

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray
    from torch import Tensor, nn


class AdamW(torch.optim.AdamW):
    """torch's fused AdamW.

    Args:
        groups: As those of every torch optimiser.
        weight_decay: Decoupled.
    """

    def __init__(self, groups: Iterable[dict[str, Any]], weight_decay: float) -> None:
        super().__init__(groups, weight_decay=weight_decay, fused=True)

    @contextmanager
    def lend(self) -> Iterator[None]:
        """For the time of a forward and a backward pass."""
        yield

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> None:  # type: ignore[override]
        """Update all parameters that have a gradient."""
        assert closure is None, "the gradients are there already"
        super().step()
        # Fused updates write to weights without saying so; trunks keep what they derive from them.
        torch.autograd.graph.increment_version(self._parameters())

    def refresh(self) -> None:
        """Take note of weights that were loaded."""

    def clip(self, largest: float) -> float:
        """Shorten the gradient as a whole; returns its L2 norm before."""
        return float(torch.nn.utils.clip_grad_norm_(self._parameters(), largest))

    def _parameters(self) -> list[nn.Parameter]:
        return [parameter for group in self.param_groups for parameter in group["params"]]


class HalfAdamW(AdamW):
    """The same, for autocast in bfloat16 on a CPU: large weights are lent to the network in bfloat16.

    Autocast rounds every float32 weight anew in each step, and turns every gradient back to float32: 12 bytes
    of memory traffic for each number, and fresh memory for both. Here the update itself, which has the
    weight at hand, writes the rounded copy and reads the gradient as it came. The weights that are kept,
    saved and judged stay float32; the network sees the same numbers as under autocast.

    Args:
        groups: As those of every torch optimiser.
        weight_decay: Decoupled.
    """

    def __init__(self, groups: Iterable[dict[str, Any]], weight_decay: float) -> None:
        super().__init__(groups, weight_decay)
        self._whole = {parameter: parameter.data for parameter in self._parameters() if is_large(parameter)}
        self._halves = {parameter: whole.to(torch.bfloat16) for parameter, whole in self._whole.items()}
        self._factor = 1.0

    @contextmanager
    def lend(self) -> Iterator[None]:
        """Large parameters are bfloat16 meanwhile, and so are the gradients that they get."""
        for parameter, half in self._halves.items():
            parameter.data = half
        try:
            yield
        finally:
            for parameter, whole in self._whole.items():
                parameter.data = whole

    def refresh(self) -> None:
        """Round the weights anew, after they were loaded."""
        for parameter, half in self._halves.items():
            half.copy_(self._whole[parameter])

    def clip(self, largest: float) -> float:
        """See `AdamW.clip`; what is large is shortened as it is used."""
        squares = [_square_sum(p.grad, self._whole.get(p)) for p in self._parameters() if p.grad is not None]
        norm = math.sqrt(math.fsum(squares))
        self._factor = min(1.0, largest / (norm + 1e-6))
        for parameter in self._parameters():
            if parameter.grad is not None and parameter not in self._halves:
                parameter.grad.mul_(self._factor)
        return norm

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> None:  # type: ignore[override]
        """See `AdamW.step`."""
        held = {p: p.grad for p in self._halves if p.grad is not None}
        for parameter in held:
            parameter.grad = None
        super().step(closure)
        for group in self.param_groups:
            for parameter in group["params"]:
                if parameter in held:
                    self._update(parameter, held[parameter], group)
        self._factor = 1.0

    def _update(self, parameter: nn.Parameter, gradient: Tensor, group: dict[str, Any]) -> None:
        from geoprior.lanes import in_lanes
        from geoprior.training._adamw_kernel import update_halves

        state = self._state_of(parameter)
        state["step"] += 1
        whole, half = self._whole[parameter], self._halves[parameter]
        tensors = (whole, state["exp_avg"], state["exp_avg_sq"], gradient, half)
        rates = self._rates(group, int(state["step"]))
        in_lanes(update_halves, whole.numel(), *(_flat(tensor, whole) for tensor in tensors), rates)

    def _state_of(self, parameter: nn.Parameter) -> dict[str, Tensor]:
        """Named as torch names it, so that either optimiser goes on from the other's."""
        state: dict[str, Tensor] = self.state[parameter]
        if not state:
            state["step"] = torch.zeros((), dtype=torch.float32)
            for name in ("exp_avg", "exp_avg_sq"):
                state[name] = torch.zeros_like(self._whole[parameter], memory_format=torch.preserve_format)
        return state

    def _rates(self, group: dict[str, Any], step: int) -> NDArray[np.float32]:
        beta1, beta2 = group["betas"]
        rate, decay, epsilon = group["lr"], group["weight_decay"], group["eps"]
        size, root = rate / (1.0 - beta1**step), math.sqrt(1.0 - beta2**step)
        numbers = [self._factor, 1.0 - rate * decay, 1.0 - beta1, beta2, 1.0 - beta2, size, root, epsilon]
        return np.array(numbers, dtype=np.float32)


def _square_sum(gradient: Tensor, whole: Tensor | None) -> float:
    """Of a gradient's numbers, which are bfloat16 where there is a whole weight beside the lent one."""
    from geoprior.lanes import in_lanes
    from geoprior.training._adamw_kernel import block_count, square_sums

    if whole is None:
        return float(torch.linalg.vector_norm(gradient)) ** 2
    sums = np.empty(block_count(gradient.numel()))
    in_lanes(square_sums, gradient.numel(), _flat(gradient, whole), sums)
    return float(sums.sum())


def _flat(tensor: Tensor, like: Tensor) -> NDArray[Any]:
    """The numbers in the order in which ``like`` has them in memory; a view where the layouts agree."""
    if tensor.stride() != like.stride():
        tensor = torch.empty_like(like, dtype=tensor.dtype, memory_format=torch.preserve_format).copy_(tensor)
    numbers = torch.as_strided(tensor, (tensor.numel(),), (1,))
    if numbers.dtype == torch.bfloat16:
        numbers = numbers.view(torch.uint16)
    array: NDArray[Any] = numbers.numpy()
    return array
