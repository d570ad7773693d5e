"""What mends what: the apt and pip lines, in one place.

Standard library only, and plain syntax: `preflight` runs this before anything is installed.
"""

from __future__ import annotations

PYTHON = "sudo apt-get install -y python3 python3-venv python3-dev"
COMPILER = "sudo apt-get install -y gcc python3-dev linux-libc-dev"
EGL = "sudo apt-get install -y libegl1 libgl1-mesa-dri"
OSMESA = "sudo apt-get install -y libosmesa6"
SIM = "pip install 'geoprior[sim]'"
CV2 = "pip install --force-reinstall --no-deps opencv-python-headless"
EVERYTHING = (
    "sudo apt-get update && sudo apt-get install -y git make gcc python3-venv python3-dev linux-libc-dev "
    "libegl1 libgl1-mesa-dri"
)
