"""Campaigns that measure the figures of documents; most write a file in docs/validation.

In the repository only: no command of RANS and no public name needs them.
"""
