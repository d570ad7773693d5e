"""Diffusion Policy (Chi et al. 2023, arXiv:2303.04137) as a policy of geoprior; `plugin` is light."""
