"""Presentation of results: reports, tables, figures and scenes."""
