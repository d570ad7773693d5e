"""Where a training's episodes come from."""
