"""Pictures and films of episodes, for people."""
