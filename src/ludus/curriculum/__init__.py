"""Parameters of worlds that change while agents train: draws and lessons."""
