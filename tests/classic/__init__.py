"""Games that were written for godot-ai, with the add-on in the place of godot-ai's own classes."""
