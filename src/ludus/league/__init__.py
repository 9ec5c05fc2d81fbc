"""Self-play: past selves, who meets whom, ratings and tournaments."""
