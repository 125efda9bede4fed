"""First import of ``rans``, which keeps files of the current folder from replacing library modules.

With ``python -m rans`` Python searches the current folder before its own library. A folder with untrusted agents
may contain a ``random.py``, which would then run. This module imports only built-in modules, and not even
``__future__``, which could be such a file.

Modules that Python imports to find RANS come earlier: ``importlib``, ``contextlib``, a dozen others, and ``rans``.
Only the command ``rans`` and ``python -P -m rans`` do not search the current folder at all.
"""

import sys


def leave_out_current_folder() -> None:
    """Remove the current folder from the front of `sys.path`, where ``python -m`` without ``-P`` has put it.

    If RANS itself is in that folder (a checkout that is not installed), the folder is searched last.
    """
    began_as_module = getattr(sys, "argv", [""])[:1] == [
        "-m"
    ]  # the value until Python has found the module
    if not began_as_module or sys.flags.safe_path or not sys.path:
        return
    folder = sys.path.pop(0)
    separator = "\\" if sys.platform == "win32" else "/"
    home = __file__.rsplit(separator, 3)[0]  # of rans/base/safe_path.py
    if home == folder and folder not in sys.path:
        sys.path.append(folder)


leave_out_current_folder()
