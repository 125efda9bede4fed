"""Orbits along which the motion near a target changes: ellipses, and nearly circular ones around an oblate planet.

`elliptic.py` and `perturbed.py` are drifts (`rans.model.drift.Drift`); `frames.py` says what Drake makes of them;
`reach.py` has the velocity with which a free point reaches a target.
"""
