"""Programs traced from the equations and from policies, and what they are printed as."""
