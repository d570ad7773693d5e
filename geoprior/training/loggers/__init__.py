"""Built-in listeners of the train-step hook, one light module each."""
