"""Drive unmodified games of Godot RL Agents (Godot 4; plug-in 0.3 to 0.8).

::

    making       ludus.make("gdrl:…")
    game         one running game: reset, step, call, end
    time_limits  which ends of episodes are time limits of the game
    connecting   starts the game, and waits for its connection
    declaring    from what the game says of itself to policies with their spaces
    messages     what is said, without input or output

Each imports only those below it.
"""
