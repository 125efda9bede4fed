"""Charts: curves, Pareto fronts, flown paths, robustness, as SVG and with matplotlib."""
