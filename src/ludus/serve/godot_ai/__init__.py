"""Serve games written for godot-ai: they bring its protocol, Ludus acts and learns.

::

    serving         puts all of it together
    server          sockets, threads, deadlines
    commands        what messages mean: a table from command to what answers it
    agents          all agents of a project, and when they are saved
    checkpoints     what is saved, under which name
    agent           one agent: SAC over one vector
    transitions     from what a game submits to what SAC learns from
    project_files   files of the project, and no others
    json_stream     from bytes to messages, without input or output
    fields          from messages to typed values
    godot_json      JSON as Godot writes it

Each imports only those below it.
"""
