"""Agents on robots: node, twin and bags; spacecraft identified from logs; foreign policies exported."""
