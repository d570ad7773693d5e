"""Two hands: synthetic motions, and a task for two arms."""

LEFT, RIGHT = "left", "right"
HANDS = (LEFT, RIGHT)
"""In pose order. Left is towards +y, as seen by somebody who looks along +x."""
