"""Films of flights (entry points ``rans.films``)."""
