"""Tables and lists of values, for terminals, pages and notebooks."""
