class_name PolicyLoader
extends RefCounted

## Stands for godot-ai's class in tests: it is there to be replaced.
