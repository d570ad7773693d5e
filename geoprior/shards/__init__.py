"""Episodes on disk: the format alone, written, read and checked; no scene and no motion is known here."""
