"""Figures of the results of this package, drawn with the names of `rans.show.figures.plotting`."""
