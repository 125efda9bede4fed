"""The end of the monitor that opens valves, over any bus: commands in time pass, and a thread shuts."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from rans_robot.bus import Bus
from rans_robot.interfaces import Message
from rans_robot.monitor import RULES

_TICK = 0.005
"""s after which the watchdog looks again, or a tenth of a control period."""
_BETWEEN = 0.002
"""s between two messages that shut the valves."""


class Valves:
    """All that opens a robot's valves goes through here; a thread shuts them, whatever the agent does meanwhile.

    A command passes if it comes in time, and none after the flight was stopped.

    Args:
        bus: to the robot.
        period: control period, s.
        shut: messages that shut all valves.
        stopped: whether somebody wants the flight to end.
    """

    def __init__(
        self, bus: Bus, period: float, shut: list[Message], stopped: Callable[[], bool]
    ) -> None:
        self._bus = bus
        self._share = round(RULES["time"].limits[0] * period * 1e9)
        self.shut = shut
        self._stopped = stopped
        self._due: int | None = None
        """When the decision was due that is computed now, ns."""
        self._passes = True
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._patience = min(_TICK, 0.1 * period)
        self._thread = threading.Thread(target=self._watch, daemon=True, name="watchdog")
        self._thread.start()

    def expect(self, due: int) -> None:
        """A decision that was due at a time of the monotonic clock, ns, is computed from now on."""
        with self._lock:
            self._passes = True
            self._due = due

    def send(self, messages: list[Message]) -> bool:
        """Send a command, unless it comes too late or after the end."""
        with self._lock:
            self._judge()
            self._due = None
            if self._passes:
                for message in messages:
                    self._bus.publish(*message)
            return self._passes

    def close(self) -> str:
        """Shut the valves several times; no error of the bus ends this.

        Returns:
            Why a message was never sent, in a sentence; "" where each was sent at least once.
        """
        self._ended.set()
        with self._lock:
            self._passes = False
            return self._shut(int(RULES["stop"].limits[0]))

    def _judge(self) -> None:
        """Shut the valves if the decision is late, or somebody wants the end."""
        late = self._due is not None and time.monotonic_ns() - self._due > self._share
        if self._passes and (late or self._stopped()):
            self._passes = False
            self._shut(int(RULES["stop"].limits[0]))

    def _watch(self) -> None:
        while not self._ended.wait(self._patience):
            with self._lock:
                if not self._ended.is_set():
                    self._judge()

    def _shut(self, times: int) -> str:
        left = {message.topic for message in self.shut}
        why = ""
        for _ in range(times):
            for message in self.shut:
                try:
                    self._bus.publish(*message)
                    left.discard(message.topic)
                except Exception as error:  # whatever a bus raises
                    why = str(error) or type(error).__name__
            time.sleep(_BETWEEN)
        if not left:
            return ""
        return f"the bus did not take the command that shuts the valves ({why}): the robot's watchdog must do it."
