"""Films of flights (entry points ``rans.films``).

Raises:
    MissingPackage: when it is imported, where FFmpeg is missing.
"""

from rans.extend import require

require("imageio_ffmpeg")
