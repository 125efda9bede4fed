"""Abilities in packages beside this one: which extra of RANS installs each, and how they are reached."""

from __future__ import annotations

from typing import Any

from rans.errors import ConfigError
from rans.registry import Registry

EXTRA_OF = {
    **dict.fromkeys(
        (
            "Avoid",
            "Circumnavigation",
            "ConvexGuidance",
            "Corridor",
            "Dock",
            "DockPort",
            "FinalApproach",
            "Hold",
            "Inspect",
            "Land",
            "LandingGuidance",
            "MissionGuidance",
            "PassiveApproach",
            "Rendezvous",
            "Slosh",
            "TargetOrbit",
            "VelocityToGain",
            "improve",
            "passive_safety",
            "read_opm",
            "relative_state",
            "write_ccsds",
        ),
        "missions",
    ),
    "assure": "assurance",
    "excite": "robot",
    "faults": "assurance",
    "fly": "robot",
    "follow": "assurance",
    "identify": "robot",
    "prove": "proof",
    "replay": "robot",
    "stress": "assurance",
    "twin": "robot",
}
"""Commands and public names that packages of this repository add, and the extra that installs each package."""

PUBLIC: Registry[Any] = Registry(
    kind="public name", group="rans.public", built_in={}, checked=lambda value: value
)
"""Public names that installed packages add to `rans` (entry points ``rans.public``)."""


def sentence_of_absent(name: str, user: str) -> str:
    """Sentence that says how to install what has an ability; empty if no package of RANS has it.

    >>> rans.abilities.sentence_of_absent("walk", "rans walk")
    ''

    Args:
        name: of a command or public name.
        user: what the user wrote, as the subject of the sentence.
    """
    extra = EXTRA_OF.get(name)
    return (
        f"{user} needs a package that is not installed: pip install 'rans[{extra}]'"
        if extra
        else ""
    )


def public(name: str) -> Any:
    """A public name of an installed package.

    Raises:
        ConfigError: the package that has it is not installed.
    """
    if name not in PUBLIC:
        raise ConfigError(sentence_of_absent(name, f"rans.{name}"))
    return PUBLIC[name]
