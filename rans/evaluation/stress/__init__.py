"""How much of each trouble contestants bear, and who bears more."""
