"""Can a stranger, a slip or an accident break it? ``python -m campaigns.breaking --help``."""
