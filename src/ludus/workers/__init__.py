"""Who plays the games of a run: this process, other processes, or other machines."""
