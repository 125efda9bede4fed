"""Charts: curves, Pareto fronts, flown paths, robustness, as SVG and with matplotlib.

Raises:
    MissingPackage: when it is imported, where matplotlib is missing.
"""

from rans.show.figures import plotting as plotting
