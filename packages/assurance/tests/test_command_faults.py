"""``rans faults``."""

import pytest

from rans.cli import main
from rans.model.spacecraft_file import load_spacecraft, to_toml


def test_tells_what_can_be_recovered_and_what_not(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "150")
    assert main(["faults", "floating-platform"]) == 0
    said = capsys.readouterr().out
    assert [
        line.split("│")[1:4] for line in said.splitlines() if line.startswith("│ two dead")
    ] == [[" two dead       ", " 16 of 28    ", " 33.3%        "]]
    assert "0+2, 0+5, 0+6, 1+3" in said


@pytest.mark.filterwarnings("ignore:spacecraft 'floating-platform'. its 1 thruster cannot push")
def test_one_thruster_is_none_to_do_without(tmp_path, refused):
    file = tmp_path / "one.toml"
    whole = to_toml(load_spacecraft("floating-platform"))
    file.write_text("[[thruster]]".join(whole.split("[[thruster]]")[:2]))
    assert "has one thruster, which it cannot do without" in refused(f"faults {file}")
