"""`geoprior plugins new`: a package that adds a plug-in, written from a small one that works."""
