"""``python -m geoprior`` is the console script."""

from geoprior.cli import main

main()
