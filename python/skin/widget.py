"""The live picture in a notebook: Jupyter, JupyterLab, VS Code, Colab.

It needs ``anywidget`` (``pip install tactile-skin[notebook]``)::

    import skin, skin.widget

    picture = skin.widget.live(skin.open(simulate=True))
    picture                     # in a cell of its own: the picture follows
    picture.stop()
"""

import threading
import time
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ._skin import Frame, SkinError, Touch

try:
    import anywidget
    import traitlets
except ImportError as error:
    raise ImportError("skin.widget needs anywidget; install it: pip install tactile-skin[notebook]") from error

__all__ = ["Picture", "live"]

LEAST_RISE = 0.05
"""Rise of the brightest colour while nothing presses more: noise stays dark."""


def _label(touch: Touch) -> str:
    number = "" if touch.id is None else f"{touch.id}: "
    if touch.force_n is None:
        limit = ("≥ " if touch.rise > 0 else "≤ ") if touch.at_limit else ""
        return f"{number}{limit}{100 * touch.rise:+.0f} %"
    return f"{number}{'~' if touch.uncalibrated else ''}{touch.force_n:.1f} N"


class Picture(anywidget.AnyWidget):
    """The picture of the frame that was shown last, with its touches; a force after ~ is that of a typical rubber."""

    _esm = Path(__file__).parent / "widget.js"
    image = traitlets.Bytes(b"").tag(sync=True)
    """Relative rise, float32 row by row, row 0 lowest, NaN off the sheet."""
    shape = traitlets.List([0, 0]).tag(sync=True)
    """Rows and columns."""
    extent_mm = traitlets.List([-1.0, 1.0, -1.0, 1.0]).tag(sync=True)
    """Left, right, bottom and top, mm."""
    most_rise = traitlets.Float(LEAST_RISE).tag(sync=True)
    """Rise of the brightest colour."""
    touches: traitlets.List[dict[str, Any]] = traitlets.List([]).tag(sync=True)
    """x_mm, y_mm, area_mm2 and label of every touch."""
    caption = traitlets.Unicode("").tag(sync=True)
    """What stands below."""
    width_px = traitlets.Int(400).tag(sync=True)
    """Width of the picture, pixels."""
    frame_number = traitlets.Int(0).tag(sync=True)
    """Frames shown so far."""

    def __init__(self, frame: Frame | None = None, **traits: Any) -> None:
        super().__init__(**traits)
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None
        if frame is not None:
            self.show(frame)

    def show(self, frame: Frame) -> None:
        """Shows a frame."""
        image = np.asarray(frame.image, dtype="<f4")
        most = float(np.nanmax(np.abs(image), initial=LEAST_RISE))
        count = len(frame.touches)
        at = "" if frame.time_s is None else f"{frame.time_s:.2f} s, "
        doubt = "" if frame.doubt is None else f". Doubt: {frame.doubt}"
        with self.hold_sync():
            self.image = image.tobytes()
            self.shape = list(image.shape)
            self.extent_mm = list(frame.extent_mm)
            self.most_rise = most
            self.touches = [
                {"x_mm": t.x_mm, "y_mm": t.y_mm, "area_mm2": t.area_mm2, "label": _label(t)} for t in frame.touches
            ]
            self.caption = f"{at}{count} touch{'' if count == 1 else 'es'}{doubt}"
            self.frame_number += 1

    def follow(self, frames: Iterable[Frame], *, rate_hz: float = 15.0) -> None:
        """Shows frames in a thread of its own until they end, or stop is called. rate_hz: most pictures a second."""
        if self.following:
            raise SkinError("this picture follows frames already; stop it first")
        if not rate_hz > 0:
            raise SkinError("rate_hz: give a number above 0")
        self._stopped.clear()
        self._thread = threading.Thread(target=self._run, args=(frames, 1 / rate_hz), name="skin.widget", daemon=True)
        self._thread.start()

    def _run(self, frames: Iterable[Frame], interval_s: float) -> None:
        next_s = 0.0
        last: Frame | None = None
        try:
            for frame in frames:
                if self._stopped.is_set():
                    break
                last = frame
                now_s = time.monotonic()
                if now_s >= next_s:
                    self.show(frame)
                    next_s, last = now_s + interval_s, None
            # However early it came, the last one stays.
            if last is not None:
                self.show(last)
        except SkinError as error:
            self.caption = f"ended: {error}"
            self.frame_number += 1
            warnings.warn(f"the picture has ended: {error}", stacklevel=1)

    @property
    def following(self) -> bool:
        """Whether it shows frames as they come."""
        return self._thread is not None and self._thread.is_alive()

    def stop(self) -> None:
        """Ends follow. The frames stay open: close them, or go on with them."""
        self._stopped.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()


def live(frames: Iterable[Frame], *, rate_hz: float = 15.0, width_px: int = 400) -> Picture:
    """A picture that follows frames: of skin.open, or any others. Stop it with its stop()."""
    picture = Picture(width_px=width_px)
    picture.follow(frames, rate_hz=rate_hz)
    return picture
