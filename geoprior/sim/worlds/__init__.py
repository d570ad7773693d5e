"""The robosuite environments behind the tasks. Heavy: imported only when one is built."""
