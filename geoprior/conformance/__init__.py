"""What every plug-in must keep to, as checks of any spec: for `plugins check` and `geoprior.testing`."""
