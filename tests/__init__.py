"""A package, for others on the index install one of this name, too, which would be found in its place."""
