"""Take trained policies out of a run, and prove that the files compute what was trained."""
