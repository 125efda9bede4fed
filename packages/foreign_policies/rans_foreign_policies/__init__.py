"""Policies of other libraries, as functions of observations (group ``rans.policies``)."""
