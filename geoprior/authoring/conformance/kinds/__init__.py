"""The contract of each kind, one module a kind; its ``CHECKS`` are what the conformance suite runs."""
