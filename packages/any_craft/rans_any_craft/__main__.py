"""See `rans_any_craft.agents`."""

import torch
import tyro

from rans_any_craft.agents import train_agent

if __name__ == "__main__":
    torch.set_num_threads(1)
    tyro.extras.subcommand_cli_from_dict({"train": train_agent}, prog="python -m rans_any_craft")
