"""What every plug-in must keep to, as checks of any spec: for `plugins check` and authors' own tests."""
