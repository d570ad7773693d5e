"""Where the numbers of a controlled arm stand in robosuite and in MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    import mujoco
    import numpy as np
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

ARM = "right"
"""What robosuite calls the arm of a robot that has a single one."""


@dataclass(frozen=True)
class RobosuiteArm:
    """An arm of a reset robosuite environment; robosuite makes new controllers at every reset.

    Attributes:
        model: MuJoCo's.
        data: MuJoCo's.
        controller: robosuite's operational-space controller.
        hand_site: Number of the site that it controls.
        base_site: Number of the site whose velocity it subtracts. On some arms (xArm7) that site rides on the
            first moving link.
        actuators: Where the torques stand in ``ctrl``.
        low: Smallest torques.
        high: Largest torques.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    controller: Any
    hand_site: int
    base_site: int
    actuators: list[int]
    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, env: Any, robot: Any) -> RobosuiteArm:
        """The arm that is one of an environment's robots."""
        model = env.sim.model._model
        controller = robot.part_controllers[ARM]
        base = f"{controller.naming_prefix}{controller.part_name}_center"
        actuators = [int(number) for number in robot._ref_actuators_indexes_dict[ARM]]
        low, high = model.actuator_ctrlrange[actuators].T.copy()
        return cls(
            model=model,
            data=env.sim.data._data,
            controller=controller,
            hand_site=model.site(controller.ref_name).id,
            base_site=model.site(base).id,
            actuators=actuators,
            low=low,
            high=high,
        )


def as_slice(numbers: Sequence[int]) -> slice | list[int]:
    """The numbers for indexing: a slice where they are consecutive, as on every arm so far.

    NumPy is then ten times faster.
    """
    plain = [int(number) for number in numbers]
    consecutive = plain == list(range(plain[0], plain[-1] + 1))
    return slice(plain[0], plain[-1] + 1) if consecutive else plain
