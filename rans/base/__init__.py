"""What every room stands on: errors, files, structure, registry, processes, and how terminals print."""
