"""Self-contained HTML pages, and what notebooks show."""
