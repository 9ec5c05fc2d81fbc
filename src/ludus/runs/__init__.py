"""What a training run leaves on disk: folder, checkpoints, metrics, requests to it."""
