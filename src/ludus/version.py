"""Version of the package; the add-on carries the same one."""

__version__ = "0.1.0"
