"""Look-ahead for RANS: `rans compare lookahead:go-to-pose-2d-trade-off#0`."""
