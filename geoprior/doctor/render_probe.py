"""Render one frame with MuJoCo and say so; run in a subprocess, since a bad GL driver may crash it.

``MUJOCO_GL=egl python -m geoprior.doctor.render_probe`` prints the milliseconds of one 96x96 frame.
"""

from __future__ import annotations

import sys
import time

SCENE = """
<mujoco>
  <worldbody>
    <light pos="0 0 2"/>
    <geom type="plane" size="1 1 0.1" rgba="0.2 0.4 0.2 1"/>
    <geom type="box" size="0.2 0.2 0.2" pos="0 0 0.2" rgba="0.9 0.2 0.1 1"/>
  </worldbody>
</mujoco>
"""


def main() -> int:
    """Print milliseconds a frame; 1 if the frame is blank."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 96, 96) as renderer:
        renderer.update_scene(data)
        renderer.render()
        clock = time.perf_counter()
        frame = renderer.render()
        milliseconds = 1000.0 * (time.perf_counter() - clock)
    print(f"{milliseconds:.1f}")  # noqa: T201 - read by the parent process
    return 0 if frame.max() > frame.min() else 1


if __name__ == "__main__":
    sys.exit(main())
