"""Everything a user can set for a training run, and how layers of settings are merged."""
