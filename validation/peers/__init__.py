"""Other simulators and trainers, measured beside ours; one script a peer.

The scripts run in environments of their own, where neither RANS nor torch need be installed: they import
their peer, the standard library and what they share, `stopwatch` above all. Each prints one line of JSON; its
keys are in `stopwatch.say`. Who has no script, and why, is in `unmeasured`.
"""
