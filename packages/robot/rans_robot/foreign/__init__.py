"""Policies of other libraries as exports of RANS: the network's operations, contract and golden pairs."""
