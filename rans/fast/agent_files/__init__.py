"""Agent files, which are read and written without running any code in them."""
