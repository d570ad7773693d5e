"""What geoprior is measured with, in a clone: `python -m benchmarks` lists it. Not part of the package."""
