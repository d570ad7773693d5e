"""ACT: action chunking with transformers. `plugin` is light; the network lives in the private modules."""
