"""The campaigns: one row of data each, of table.toml. See `campaigns.runner.Campaign`.

``python -m campaigns NAME`` measures one; spaces of its name are written as dashes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from campaigns.markdown import Table
from campaigns.runner import Campaign
from rans.base.files import read_text
from rans.base.structure import read_toml, structure


def read_campaigns(file: Path) -> dict[str, Campaign]:
    """Campaigns of a file by their names, in its order; ConfigError if a row has something else than a campaign."""
    rows = read_toml(read_text(file))
    columns = rows.pop("columns")

    def row(name: str, table: Any) -> Campaign:
        for shown in (*table.get("tables", {}).values(), *table.get("prints", {}).values()):
            if isinstance(shown.get("columns"), str):
                shown["columns"] = columns[shown["columns"]]
        return structure(table, Campaign, f"{name} of {file.name}")

    return {name: row(name, table) for name, table in rows.items()}


CAMPAIGNS = read_campaigns(Path(__file__).with_suffix(".toml"))
"""By what is measured, the table of robustness first; the last ones have no table that is flown again."""
ROWS = {name: campaign for name, campaign in CAMPAIGNS.items() if campaign.tables}
"""Campaigns whose tables stand on pages, which `python -m campaigns reproduce` flies again, by name."""
PAGES = {name: campaign for campaign in CAMPAIGNS.values() for name in campaign.tables}
"""Campaigns by the names of their tables."""


def table(docs: Path, name: str) -> Table:
    """Table of this name, of the evidence in docs/validation."""
    return PAGES[name].table(docs, name)
