"""A strip chart of reference, torque and command, as an image or a window."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import check_name

RENDER_MODES = ("human", "rgb_array")
LENGTH = 1000  # samples: a second at the usual control step
LABELS = ("reference", "joint torque", "motor command")
COLOURS = ("#888888", "#0b6fb8", "#d9822b")


class StripChart:
    """The last second of an episode, where it is to be drawn."""

    def __init__(self, mode: str | None, dt: float, labels: tuple[str, ...] = LABELS) -> None:
        """Prepare an empty chart of torques, one sample every `dt` [s].

        The mode is "human" for a window, "rgb_array" for images, None to draw nothing.
        """
        self.mode = mode
        if mode is None:
            return
        check_name("render mode", mode, RENDER_MODES)
        from matplotlib.figure import Figure

        self.dt = dt
        self.rows: deque[tuple[float, ...]] = deque(maxlen=LENGTH)
        self.count = 0
        self.figure = Figure(figsize=(8.0, 4.0), dpi=80, layout="constrained")
        self.axes = self.figure.add_subplot()
        self.axes.set(xlabel="time [s]", ylabel="torque [N m]")
        self.axes.grid(alpha=0.3)
        self.lines = [
            self.axes.plot([], [], color=colour, label=label, linewidth=1.2)[0]
            for label, colour in zip(labels, COLOURS, strict=False)
        ]
        self.axes.legend(loc="upper right", ncols=3, frameon=False)
        self._window: Any = None

    def clear(self) -> None:
        """Forget all samples."""
        if self.mode is not None:
            self.rows.clear()
            self.count = 0

    def add(self, *torques: float) -> None:
        """Add a sample, a value for each label [N m], and draw it where there is a window."""
        if self.mode is None:
            return
        self.rows.append(torques)
        self.count += 1
        if self.mode == "human":
            self._show()

    def _update(self) -> None:
        data = np.array(self.rows).reshape(-1, len(self.lines))
        t = (self.count - len(data) + 1 + np.arange(len(data))) * self.dt
        for j, line in enumerate(self.lines):
            line.set_data(t, data[:, j])
        self.axes.relim()
        self.axes.autoscale_view()

    def render(self) -> NDArray[np.uint8] | None:
        """Return the chart for "rgb_array", None for other modes."""
        return self.image() if self.mode == "rgb_array" else None

    def image(self) -> NDArray[np.uint8]:
        """Return the chart, shape (height, width, 3)."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        self._update()
        canvas: Any = FigureCanvasAgg(self.figure)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()

    def _show(self) -> None:
        """Show the chart in a window, redrawn every 50 samples."""
        import matplotlib.pyplot as plt

        if self._window is None:
            self._window = plt.figure(figsize=(8.0, 4.0))
        if self.count % 50 == 1:
            self._window.clear()
            self._window.figimage(self.image())
            self._window.canvas.draw_idle()
            self._window.canvas.flush_events()
            plt.pause(0.001)

    def close(self) -> None:
        """Close the window."""
        if self.mode is not None and self._window is not None:
            import matplotlib.pyplot as plt

            plt.close(self._window)
            self._window = None
