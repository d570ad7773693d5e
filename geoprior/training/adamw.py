"""AdamW, and a form of it for training in bfloat16 on a CPU."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple, cast

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
        self._seen: dict[nn.Parameter, _Arrays] = {}
        self._gradients: dict[nn.Parameter, NDArray[np.uint16]] = {}
        self._factor = 1.0

    @contextmanager
    def lend(self) -> Iterator[None]:
        """Large parameters are bfloat16 meanwhile, and so are the gradients that they get."""
        self._gradients = {}
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
        learned = [parameter for parameter in self._parameters() if parameter.grad is not None]
        small = [parameter for parameter in learned if parameter not in self._halves]
        squares = [_square_sum(self._gradient_of(p)) for p in learned if p in self._halves]
        gradients = [p.grad for p in small if p.grad is not None]
        squares.append(float(torch.nn.utils.get_total_norm(gradients)) ** 2)
        norm = math.sqrt(math.fsum(squares))
        self._factor = min(1.0, largest / (norm + 1e-6))
        torch.nn.utils.clip_grads_with_norm_(small, largest, torch.tensor(norm))
        return norm

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> None:  # type: ignore[override]
        """See `AdamW.step`."""
        held = {p: p.grad for p in self._halves if p.grad is not None}
        arrays = {parameter: self._gradient_of(parameter) for parameter in held}
        for parameter in held:
            parameter.grad = None
        super().step(closure)
        for group in self.param_groups:
            rates: dict[int, NDArray[np.float32]] = {}
            for parameter in group["params"]:
                if parameter in held:
                    self._update(parameter, arrays[parameter], group, rates)
        self._gradients = {}
        self._factor = 1.0

    def _update(
        self,
        parameter: nn.Parameter,
        gradient: NDArray[np.uint16],
        group: dict[str, Any],
        rates: dict[int, NDArray[np.float32]],
    ) -> None:
        from geoprior.lanes import in_lanes
        from geoprior.training._adamw_kernel import update_halves

        state = self._state_of(parameter)
        state["step"] += 1
        step = int(state["step"])
        if step not in rates:
            rates[step] = self._rates(group, step)
        seen = self._seen_of(parameter, state)
        arrays = (seen.whole, seen.mean, seen.square, gradient, seen.half)
        in_lanes(update_halves, gradient.size, *arrays, rates[step])

    def _seen_of(self, parameter: nn.Parameter, state: dict[str, Tensor]) -> _Arrays:
        """Views that last until other running means are loaded, which are laid out as the weight is."""
        seen = self._seen.get(parameter)
        if seen is not None and seen.source is state["exp_avg"]:
            return seen
        whole = self._whole[parameter]
        for name in ("exp_avg", "exp_avg_sq"):
            state[name] = _laid_out(state[name], whole)
        mean, square = state["exp_avg"], state["exp_avg_sq"]
        arrays = (_flat(tensor) for tensor in (whole, mean, square, self._halves[parameter]))
        seen = self._seen[parameter] = _Arrays(mean, *arrays)
        return seen

    def _gradient_of(self, parameter: nn.Parameter) -> NDArray[np.uint16]:
        """Its numbers in the order of the weight's in memory."""
        found = self._gradients.get(parameter)
        if found is None:
            gradient = _laid_out(cast("Tensor", parameter.grad), self._whole[parameter])
            found = self._gradients[parameter] = _flat(gradient)
        return found

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


class _Arrays(NamedTuple):
    """The numbers of a large weight in the order of memory, and the tensor whose change makes them stale."""

    source: Tensor
    whole: NDArray[np.float32]
    mean: NDArray[np.float32]
    square: NDArray[np.float32]
    half: NDArray[np.uint16]


def _square_sum(gradient: NDArray[np.uint16]) -> float:
    from geoprior.lanes import in_lanes
    from geoprior.training._adamw_kernel import block_count, square_sums

    sums = np.empty(block_count(gradient.size))
    in_lanes(square_sums, gradient.size, gradient, sums)
    return float(sums.sum())


def _laid_out(tensor: Tensor, like: Tensor) -> Tensor:
    """The tensor, or a copy of it where it does not lie in memory as another of its shape does."""
    if tensor.stride() == like.stride():
        return tensor
    return torch.empty_like(like, dtype=tensor.dtype, memory_format=torch.preserve_format).copy_(tensor)


def _flat(tensor: Tensor) -> NDArray[Any]:
    """A view of a dense tensor's numbers in the order in which they lie in memory."""
    from geoprior.lanes import numbers_of

    return numbers_of(torch.as_strided(tensor, (tensor.numel(),), (1,)))
