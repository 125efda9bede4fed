"""Controllers beside each other, between what none can beat and what simple ones reach.

`protocol` says how contestants fly and are scored, `relaxed` and `certified` what is possible, `run` does
it all, and `figures`, `tables` and `page` show it. docs/comparison.md is the protocol for people.
"""
