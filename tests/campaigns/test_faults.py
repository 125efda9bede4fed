"""The table of faults, against the flights that evaluations are made of and numbers worked by hand."""

from campaigns.faults import rows
from rans.model.spacecraft_file import load_spacecraft


def test_rows_are_every_class_that_the_craft_has():
    found = list(rows(load_spacecraft("floating-platform"), 25.0))
    assert [row.name for row in found if "," not in row.name] == ["none"]
    at_once = [row.name for row in found if row.at_start]
    assert [name.replace(", ", " ").replace("recoverable ", "") for name in at_once[1:]] == [
        "one dead (8)",
        "one stuck-open (8)",
        "one weak (8)",
        "two dead (16)",
        "two stuck-open (16)",
        "two weak (28)",
        "two dead un(12)",
        "two stuck-open un(12)",
    ]
    assert {row.faults.time for row in found} == {0.0, (0.0, 15.0), (0.0, 25.0)}
