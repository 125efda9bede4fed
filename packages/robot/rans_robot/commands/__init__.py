"""The commands, dataclasses whose fields are options."""
