"""A policy's loss through torch.compile."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch

from geoprior.errors import MachineError

if TYPE_CHECKING:
    from collections.abc import Callable

_REMEDY = "set compile to false, or install what torch.compile needs (on a CPU a C++ compiler, named in CXX)"


def compile_loss(loss: Callable[..., Any]) -> Callable[..., Any]:
    """The same loss, compiled at its first call and for every new shape of a batch.

    What is drawn at random inside is drawn in another way, from the same generator.

    Raises:
        MachineError: At a call: torch.compile does not work here, or not with this policy.
    """
    compiled = torch.compile(loss)

    def attempt(*batch: Any) -> Any:
        try:
            return compiled(*batch)
        except torch._dynamo.exc.TorchDynamoException as error:  # torch has no public name for it
            sentence = str(error).strip().splitlines()[0]
            raise MachineError(f"torch.compile fails: {sentence}", _REMEDY) from error

    return attempt
