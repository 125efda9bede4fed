"""Backbone of RANS's policies that attends to effectors."""
