"""Controls of a flight that is played."""

from __future__ import annotations

from typing import Any

from rans.api.pages import flyers
from rans.show.scene.play import BACK, KILL, PAUSE, SWITCH, LivePlayground

SEED = 7


def press(playground: LivePlayground, button: str) -> None:
    """As a browser tells it: a message of type button, in MessagePack."""
    message = b"\x82\xa4type\xa6button\xa4name" + bytes([0xA0 + len(button)]) + button.encode()
    window: Any = playground.meshcat
    window._InjectWebsocketMessage(message)


def test_buttons_and_sliders_do_what_they_say() -> None:
    lines: list[str] = []
    runs = flyers(("lqr:go-to-pose-2d", "switching"), None, False)
    playground = LivePlayground(runs, SEED, 3, lines.append)

    def advance(count: int = 1) -> None:
        for _ in range(count):
            playground.advance(lambda _: None)

    advance(10)
    press(playground, PAUSE)
    before = playground.flight.time
    advance(3)
    assert playground.flight.time == before
    assert lines[-1].endswith("paused")
    press(playground, PAUSE)
    playground.meshcat.SetSliderValue("thruster", 5)
    press(playground, KILL)
    press(playground, SWITCH)
    playground.meshcat.SetSliderValue("goal x (m)", 1.0)
    advance()
    assert playground.flight.dead == {5}
    assert playground.flight.controller.name == "switching"
    assert float(playground.flight.goal.p.x[0]) == 1.0
    press(playground, BACK)
    playground.running = False
    advance()
    assert playground.flight.time == 0.0
