"""What learns: the policy protocol, normalisation, checkpoints, and ACT."""
