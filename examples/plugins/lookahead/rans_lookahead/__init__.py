"""Look-ahead for RANS: `rans compare lookahead:go-to-pose-2d-fast`."""
