"""Functions behind the commands: each takes names, files or objects, and returns its result.

They are at the top of the package (``rans.evaluate``), load what they need when they are called, and show
progress on a terminal and in a notebook.
"""
