//! No code: the manifest unifies features of dependencies.
