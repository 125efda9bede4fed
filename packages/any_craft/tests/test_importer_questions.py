"""What a spacecraft file of other software may say that it should not is refused, or named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import rans
from rans.errors import ConfigError
from rans.model.foreign import read_foreign


def link(name: str, mass: str = "17", pose: str = "", i: str = "0.3") -> str:
    tensor = f"<ixx>{i}</ixx><iyy>{i}</iyy><izz>{i}</izz>"
    inertial = f"<inertial><mass>{mass}</mass><inertia>{tensor}</inertia></inertial>"
    return f"<link name='{name}'>{pose}{inertial}</link>"


def jet(name: str, number: int) -> str:
    return (
        f"<plugin name='gz::sim::systems::SpacecraftThrusterModel'><link_name>{name}</link_name>"
        f"<actuator_number>{number}</actuator_number><max_thrust>1</max_thrust></plugin>"
    )


def drafted(file: Path) -> object:
    return rans.init_spacecraft("mine", base=file, dimension=3)


FAR = "<pose>120 0 0 0 0 0</pose>"
REFUSED = {
    "frames": ((link("b", pose="<pose relative_to='x'/>"),), "relative to 'x'"),
    "order": (
        (link("b"), link("c"), link("d"), jet("c", 1), jet("d", 1)),
        "one actuator_number, 1",
    ),
    "sizes": ((link("b"), "<!--" + "x" * 2**24 + "-->"), "are read; it is probably"),
    "evidence": ((link("b"), link("leg", "-1")), "mass of the link 'leg'"),
}
WARNED = {
    "units": ((link("b"), link("jet", "0.1", FAR), jet("jet", 0)), "positions in mm or cm"),
    "dropped": (
        (link("b"), link("jet"), jet("jet", 0), "<plugin name='Camera'/>"),
        r"\['Camera'\] are not read",
    ),
}


def planted(folder: Path, parts: tuple[str, ...]) -> Path:
    file = folder / "m.sdf"
    file.write_text(f"<sdf><model name='m'>{''.join(parts)}</model></sdf>")
    return file


@pytest.mark.parametrize("question", REFUSED)
def test_read_foreign_refuses(question: str, tmp_path: Path) -> None:
    parts, sentence = REFUSED[question]
    with pytest.raises(ConfigError, match=sentence):
        read_foreign(planted(tmp_path, parts))


@pytest.mark.parametrize("question", WARNED)
@pytest.mark.filterwarnings("ignore:spacecraft .* cannot push and turn it")
def test_what_read_foreign_leaves_out_is_said(question: str, tmp_path: Path) -> None:
    parts, sentence = WARNED[question]
    with pytest.warns(rans.RansWarning, match=sentence):
        drafted(planted(tmp_path, parts))


@pytest.mark.parametrize("suffix", [".urdf", ".sdf", ".txt"])
def test_without_the_package_its_extra_is_named(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a core that has none of the entry points."""
    from rans.model.foreign import IMPORTERS

    absent: Callable[[], dict[str, list[object]]] = dict
    monkeypatch.setattr(IMPORTERS, "_offered", absent())
    monkeypatch.setattr(IMPORTERS, "_loaded", {})
    file = tmp_path / f"craft{suffix}"
    file.write_text("<robot/>")
    with pytest.raises(ConfigError, match=r"pip install 'rans\[any_craft\]'"):
        read_foreign(file)
