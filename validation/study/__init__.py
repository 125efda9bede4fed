"""The study behind `rans validate`: lists of checks, each with a tolerance and its reason."""
