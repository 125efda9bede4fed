"""The Drake reference: an independent simulation of the same spacecraft.

Raises:
    MissingPackage: when it is imported, where Drake is missing.
"""

from rans.base.errors import require

require("pydrake")
