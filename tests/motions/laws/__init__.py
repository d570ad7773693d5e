"""What Section III of the paper says of an episode, one function a sentence.

A law takes a planned episode and asserts. It recomputes what it needs from the paper's equations and from the
default options, not with the package's own functions, wherever the two could share a mistake.
"""

from laws.always import ALWAYS
from laws.grasping import GRASPING, PICK, PLACE
from laws.marker import MARKER
from laws.pushing import PUSH
from laws.start import START

LAWS = {
    "pick": START + ALWAYS + GRASPING + PICK,
    "place": START + ALWAYS + GRASPING + PLACE + MARKER,
    "push": START + ALWAYS + PUSH + MARKER,
}
"""The laws of each motion."""
