"""Pages of the results of this package."""
