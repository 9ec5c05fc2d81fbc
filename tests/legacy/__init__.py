"""Legacy bridges: games written for other projects, driven or served by Ludus as they are."""
