"""A campaign of random faults against training runs: ``python -m tests.campaign --help``.

`faults/` holds the faults, one kind in a file, `promises.py` what is checked after each of them.
A round draws all it does from its seed and its number, so that both replay it.
"""
