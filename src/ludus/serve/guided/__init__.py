"""Serve games that guide their own training: they ask, Ludus trains.

::

    serving     one game after the other, and what happens when one ends
    guidance    what is done for a game: stand by, train, play a round
    rounds      one episode in every world, for people to watch
    game_run    the run of a game: resumed, new, or new beside an old one
    game_server accepts games, one at a time; in a separate thread, beside training

Each imports only those below it.
"""
