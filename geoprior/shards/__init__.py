"""Episodes on disk: the contract, the writer, the reader."""
