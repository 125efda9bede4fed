"""Contestants from the same starts beside what is physically possible."""
