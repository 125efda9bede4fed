"""Imported first of all by ``rans``: nothing of the current folder is imported in the place of a library.

``python -m rans`` has Python look in the current folder before its own library. A folder with a stranger's
agents may hold a ``random.py``, which would then run. This module imports nothing that is not built in, not
even ``__future__``, which could be such a file.

What Python itself imports to find RANS comes before: ``importlib``, ``contextlib`` and a dozen others, and
``rans``. Only the command ``rans``, and ``python -P -m rans``, look nowhere else.
"""

import sys


def leave_out_current_folder() -> None:
    """Undo what ``python -m`` did to `sys.path`, if this process began so, and not with ``-P``.

    Where RANS itself is of that folder, a checkout that is not installed, the folder is looked through last.
    """
    began_as_module = getattr(sys, "argv", [""])[:1] == [
        "-m"
    ]  # so it is until the module was found
    if not began_as_module or sys.flags.safe_path or not sys.path:
        return
    folder = sys.path.pop(0)
    package = __file__.rpartition("/")[0]
    home = package.rpartition("/")[0]
    if home == folder and folder not in sys.path:
        sys.path.append(folder)


leave_out_current_folder()
