"""``rans init``: a commented TOML file of your own spacecraft from the numbers of a data sheet."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from tyro.conf import Positional, UseAppendAction, arg

from rans.api.drafting import init_spacecraft
from rans.cli.door import Options, argument_texts, command_of
from rans.errors import ConfigError, brief, is_installed, meant
from rans.terminal import Terminal

if TYPE_CHECKING:
    from rans.api.drafting import Draft
    from rans.model.foreign import Foreign
    from rans.model.spacecraft import Spacecraft

Answer = TypeVar("Answer")
KINDS: dict[str, type] = {
    **dict.fromkeys(("dimension", "counts"), int),
    **dict.fromkeys(("mass", "least", "most", "radius"), float),
    **dict.fromkeys(("name", "actuators", "thrust_sharing"), str),
    **dict.fromkeys(("inertia", "size", "centre_of_mass"), list),
}
"""Kinds of the values of --set, by their keys."""


@command_of(
    init_spacecraft,
    without=("name", *KINDS),
    base=Annotated[str | None, arg(name="from", metavar="SPACECRAFT")],
    thrusters=Annotated[
        UseAppendAction[tuple[str, ...]], arg(name="thruster", metavar="POSITION;DIRECTION;FORCE")
    ],
    wheels=Annotated[
        UseAppendAction[tuple[str, ...]], arg(name="wheel", metavar="AXIS;TORQUE;MOMENTUM;INERTIA")
    ],
)
class Init(Options):
    """Write the TOML file of a new spacecraft, draw its thrusters, and print its control authority.

    It asks for missing values. The authority is the largest force along each axis, and the largest torque
    about it, while all others are zero. --thruster and --wheel are repeated for each. Ctrl-C before the
    last answer writes nothing.
    """

    group = "Check"
    guide = "docs/spacecraft.md"
    examples = (
        "rans init mine.toml",
        "rans init mine.toml --from atmos --set mass=16",
        'rans init mine.toml --set mass=12 --set size=0.4,0.4 --thruster "-0.2,0.1;1,0;1.5"',
    )

    file: Annotated[Path, Positional, arg(metavar="FILE.toml")]
    """File to write."""
    set: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="KEY=VALUE")] = ()

    def following(self) -> tuple[str, ...]:
        """See `rans.cli.commands.Command`."""
        return (f"rans list {shlex.quote(str(self.file))}",)

    def run(self) -> int:
        """Ask, check, write and draw; the exit code is 0. Nothing is written before the last answer."""
        from rans.api.drafting import check_free, check_target

        if not self.file.name:
            raise ConfigError(
                f"name the file to write, such as mine.toml, got {str(self.file)!r}, which is a folder."
            )
        picture = self.file.with_suffix(".svg") if is_installed("matplotlib") else None
        check_target(self.file)
        if picture is not None:
            check_free(picture)
        asks = sys.stdin is not None and sys.stdin.isatty()
        try:
            draft = self._asked() if asks else self._unasked()
        except EOFError as error:
            raise ConfigError(
                "the input ended before the last answer: nothing was written."
            ) from error
        draft.write(self.file, picture)
        self._show(draft, picture)
        return 0

    def _given(self) -> dict[str, Any]:
        """Values of --set by their keys, of the kinds of `KINDS`; a wrong one is refused (`ConfigError`)."""
        from rans.model.spacecraft_draft import numbers_of_text

        values: dict[str, Any] = {}
        for change in self.set:
            key, _, text = change.partition("=")
            if key not in KINDS or key in values or not text:
                raise ConfigError(
                    f"--set takes KEY=VALUE once for each of {', '.join(KINDS)}, got {brief(change)}"
                    f"{meant(key, KINDS)}."
                )
            kind = KINDS[key]
            if kind is list:
                values[key] = numbers_of_text(text, key, (1, 3) if key == "inertia" else (2, 3))
                continue
            try:
                values[key] = kind(text)
            except ValueError:
                raise ConfigError(
                    f"--set {key} takes a {'whole ' * (kind is int)}number, got {brief(text)}."
                ) from None
        return values

    def _drafted(self, answers: dict[str, Any]) -> Draft:
        """Draft from the options and these answers, which win over options."""
        options: dict[str, Any] = {
            "name": self.file.stem,
            "base": self.base,
            "thrusters": self.thrusters,
            "wheels": self.wheels,
        }
        return init_spacecraft(**options | self._given() | answers)

    def _unasked(self) -> Draft:
        """Draft from the options alone; where they say too little, the refusal says why nothing is asked."""
        given = self._given().keys()
        known = {"dimension", "mass"} <= given and {"inertia", "size"} & given and self.thrusters
        try:
            return self._drafted({})
        except ConfigError as error:
            if known or self.base is not None:
                raise
            raise ConfigError(
                f"{error} The input is no terminal, so that nothing is asked: give values by --set KEY=VALUE, and "
                "each thruster by --thruster POSITION;DIRECTION;FORCE."
            ) from error

    def _asked(self) -> Draft:
        """Ask for values without an option; a wrong answer is explained and asked for again."""
        from rans.api.drafting import begun
        from rans.model.foreign import Foreign
        from rans.model.spacecraft_draft import numbers_of_text, thruster_of, wheel_of

        base = begun(self.base)
        foreign = base if isinstance(base, Foreign) else None
        start: Spacecraft | None = None if isinstance(base, Foreign) else base
        given = self._given()
        answers: dict[str, Any] = {}

        def number(text: str) -> float:
            return numbers_of_text(text, "this", (1,))[0]

        def mass(text: str) -> float:
            return _positive(numbers_of_text(text, "the mass", (1,)), "the mass")[0]

        # `input` prints past the stream: this ends the line "rans init: loading ..." before a question.
        sys.stdout.write("")
        # Mass properties; what a base or an imported file says is not asked for.
        if "name" not in given:
            answers["name"] = ask("Name", str, self.file.stem)
        dimension = start.dimension if start is not None else given.get("dimension")
        if dimension is None:
            dimension = ask("Does it move in the plane (2) or in space (3)", _dimension, "2")
            answers["dimension"] = dimension
        if "mass" not in given and foreign is None:
            answers["mass"] = ask("Mass, kg", mass, None if start is None else f"{start.mass:g}")
        has_inertia = foreign is not None and foreign.inertia is not None
        if not {"inertia", "size"} & given.keys() and not has_inertia:
            answers |= _ask_inertia(dimension, start)
        if start is None and foreign is None and "centre_of_mass" not in given:
            zeros = ", ".join(["0"] * dimension)
            answers["centre_of_mass"] = ask(
                "Centre of mass in the frame in which you measure thrusters, m",
                lambda text: numbers_of_text(text, "the centre of mass", (dimension,)),
                zeros,
            )
        # Effectors.
        if start is None and "actuators" not in given:
            answers |= _ask_actuators(number, given, dimension)
        if foreign is not None and foreign.nozzles and not self.thrusters:
            answers["thrusters"] = _ask_nozzles(foreign, dimension)
        elif start is None and not self.thrusters:
            example = "0.2, 0.1; 1, 0; 1.5" if dimension == 2 else "0.2, 0.1, 0; 1, 0, 0; 1.5"
            print(f"Thrusters: position (m); direction of the force; force (N), such as {example}")
            answers["thrusters"] = _ask_each(
                "Thruster", lambda text: thruster_of(text, dimension), 1
            )
        if start is None and foreign is None and not self.wheels:
            print("Reaction wheels: axis; torque (N m); momentum (N m s); inertia (kg m^2)")
            answers["wheels"] = _ask_each("Wheel", lambda text: wheel_of(text, dimension), 0)
        return self._drafted(answers)

    def _show(self, draft: Draft, picture: Path | None) -> None:
        """Print control authority, recoverable faults, and the next commands."""
        from rans.api.drafting import AUTHORITY_COLUMNS
        from rans.cli.details import prospects
        from rans.cli.next_commands import training
        from rans.model.spacecraft import is_steerable
        from rans.policy.prospects import slips
        from rans.pretrained import FOR_ANY_CRAFT
        from rans.table import Table

        # Control authority, whether it settles, and thrusters without which it still does.
        craft = draft.spacecraft
        console = Terminal()
        console.table(
            Table(
                AUTHORITY_COLUMNS,
                draft.authority_rows(),
                f"{craft.name}: largest force and torque, with every other one at zero",
            )
        )
        steerable = is_steerable(craft)
        for sentence in prospects(craft) if steerable else slips(craft):
            console.say(sentence)
        console.say(f"Written: {self.file}" + (f" and {picture}" if picture else ""))
        file = shlex.quote(str(self.file))
        agent = FOR_ANY_CRAFT[craft.dimension]
        console.suggest(
            *([f"rans compare {file}", f"rans view {agent}@{file}"] if steerable else []),
            f"rans list {file}",
            # What cannot be steered is not worth a training.
            *([f"rans validate {file} --quick"] if steerable else []),
            *(training(craft, str(self.file)) if steerable else []),
        )


_MEANINGS = argument_texts(init_spacecraft)
Init.texts["set"] = (
    "A value of the data sheet, as in `--set mass=12` or `--set size=0.4,0.4`; may be repeated. Keys: "
    + ", ".join(f"{key} ({text.rstrip('.')})" for key, text in _MEANINGS.items() if key in KINDS)
    + "."
)


def _ask_actuators(
    number: Callable[[str], float], given: Mapping[str, Any], dimension: int
) -> dict[str, Any]:
    """Ask for the kind of valves or engines, and for its numbers that are not given."""
    from rans.model.actuators import KINDS
    from rans.model.spacecraft_draft import actuators_of
    from rans.policy.timing import PERIODS, PERIODS_IN_SPACE

    last = f" to {PERIODS_IN_SPACE[-1]:g}" if dimension == 3 else ""

    def counts(text: str) -> int:
        if (value := number(text)) != int(value):
            raise ConfigError(f"this must be a whole number, got {brief(text)}.")
        actuators_of(kind, int(value), None, None)
        return int(value)

    def least(text: str) -> float:
        value = number(text)
        actuators_of(kind, answers.get("counts", given.get("counts")), value, given.get("most"))
        return value

    kind = ask(f"Actuators: {', '.join(KINDS)}", _member(KINDS), "on-off")
    answers: dict[str, Any] = {"actuators": kind}
    if kind == "pulsed" and "counts" not in given:
        answers["counts"] = ask(
            f"Into how many steps do valves divide a control period of {PERIODS[0]:g}{last} s",
            counts,
            "100",
        )
        answers["least"] = ask("Shortest pulse, in these steps", least, "1")
    if kind == "throttle" and "least" not in given:
        answers["least"] = ask("Least level, a share of full force", least, "0")
    return answers


def ask(question: str, read: Callable[[str], Answer], default: str | None = None) -> Answer:
    """Ask a question until the answer is valid; an empty answer is the default."""
    hint = "" if default is None else f" [{default}]"
    while True:
        text = input(f"{question}{hint}: ").strip() or (default or "")
        if not text:
            print("This has no default: type an answer, or Ctrl-C to stop.")
            continue
        try:
            return read(text)
        except ConfigError as error:
            print(error)


def _ask_each(noun: str, read: Callable[[str], Answer], least: int) -> tuple[Answer, ...]:
    """Ask for ``least`` or more answers, one a line, until an empty one; a wrong answer is asked again."""
    results: list[Answer] = []
    while True:
        text = input(f"{noun} {len(results)} (empty: no more): ").strip()
        if not text and len(results) >= least:
            return tuple(results)
        if not text:
            print(f"It needs at least {least}.")
            continue
        try:
            results.append(read(text))
        except ConfigError as error:
            print(error)


def _ask_nozzles(foreign: Foreign, dimension: int) -> tuple[str, ...]:
    """Thrusters of a file of other software, with the positions and forces that it does not say."""
    from rans.model.foreign import Nozzle
    from rans.model.spacecraft_draft import numbers_of_text

    nozzles = []
    last: str | None = None
    for nozzle in foreign.nozzles:
        position = nozzle.position
        force = nozzle.force
        if position is None:
            x, y, *z = ask(
                f"Position of {nozzle.name}, m",
                lambda text: numbers_of_text(text, "the position", (dimension,)),
            )
            position = (x, y, z[0] if z else 0.0)
        if force is None:
            (force,) = ask(
                f"Force of {nozzle.name}, N",
                lambda text: numbers_of_text(text, "the force", (1,)),
                last,
            )
            last = f"{force:g}"
        nozzles.append(Nozzle(nozzle.name, position, nozzle.direction, force))
    return replace(foreign, nozzles=tuple(nozzles)).thrusters(dimension)


def _ask_inertia(dimension: int, start: Spacecraft | None) -> dict[str, Any]:
    """Ask for moments of inertia or the sides of a box; empty if those of the base are kept."""
    from rans.model.spacecraft_draft import numbers_of_text

    counts = (1,) if dimension == 2 else (1, 3)

    def read(text: str) -> tuple[float, ...] | None:
        if text == "box":
            return None
        moments = _positive(numbers_of_text(text, "the inertia", counts), "the inertia")
        if len(moments) == 3 and 2.0 * max(moments) > sum(moments) * (1.0 + 1e-9):
            raise ConfigError(
                f"no moment of inertia of a rigid body exceeds the sum of the other two, got {brief(text)}."
            )
        return moments

    if start is not None:
        unchanged = "as it is"
        inertia = ask(
            "Moments of inertia, kg m^2",
            lambda text: None if text == unchanged else read(text),
            unchanged,
        )
        return {} if inertia is None else {"inertia": inertia}
    print("Moment of inertia about the centre of mass, or type box for that of a uniform box.")
    inertia = ask("Inertia, kg m^2", read)
    if inertia is not None:
        return {"inertia": inertia}
    sides = "x, y" if dimension == 2 else "x, y, z"

    def size(text: str) -> tuple[float, ...]:
        return _positive(numbers_of_text(text, "the sides", (dimension,)), "the sides")

    return {"size": ask(f"Sides {sides}, m", size)}


def _positive(values: tuple[float, ...], what: str) -> tuple[float, ...]:
    from rans.model.spacecraft_draft import LEAST

    if min(values) < LEAST:
        raise ConfigError(f"{what} must be at least {LEAST:g}, got {min(values):g}.")
    return values


def _dimension(text: str) -> int:
    if text not in ("2", "3"):
        raise ConfigError(f"type 2 (plane) or 3 (space), got {text!r}.")
    return int(text)


def _member(kinds: Any) -> Callable[[str], str]:
    """A function that reads an answer which must be one of these words."""

    def read(text: str) -> str:
        if text not in kinds:
            raise ConfigError(f"type one of {', '.join(kinds)}, got {text!r}.")
        return text

    return read
