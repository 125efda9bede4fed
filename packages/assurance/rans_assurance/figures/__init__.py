"""Figures of the results of this package.

The backend of figures is decided before any module here imports matplotlib.
"""

from rans import backend as backend
