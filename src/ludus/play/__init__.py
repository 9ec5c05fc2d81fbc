"""Play a game without learning from it.

::

    evaluation      complete episodes, chosen before they begin; `ludus evaluate`
    interactive     one world in a window or without one, or a person who plays; `ludus play`
    in_engine       policies that the game plays itself
    command_line    starts a game for people
    watched         tells a game that shows an agent what was decided for it
    playing         steps a pool and follows its episodes
    players         trained runs, policy files, random actions
    episodes        returns, lengths and numbers of episodes

Each imports only those below it.
"""
