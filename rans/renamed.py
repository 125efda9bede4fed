"""Words of every warning of a former name."""

DEPRECATED = "is deprecated and will be removed in the next version"
