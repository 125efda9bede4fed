"""Trained agents for RANS: one folder per agent, and no code (see `rans.base.pretrained`)."""
