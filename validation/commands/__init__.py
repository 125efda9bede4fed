"""The commands `rans validate` and `rans benchmark`."""
