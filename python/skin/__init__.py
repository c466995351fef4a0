"""A tactile skin read by electrical impedance tomography, in Python.

The first touch, without a board::

    import skin

    for frame in skin.open(simulate=True):
        for touch in frame.touches:
            print(touch.id, touch.x_mm, touch.y_mm, touch.force_n)

Frames of other hardware: :func:`reconstruct`. A simulated frame: :func:`forward`. A recording in memory: :func:`load`.
Lengths are mm from the sheet's origin, times s, values V. All that takes long runs without the interpreter's lock.
"""

from ._skin import (
    Frame,
    Reconstructor,
    Recording,
    Sheet,
    Skin,
    SkinError,
    SkinWarning,
    Touch,
    forward,
    load,
    open,
    reconstruct,
)

__all__ = [
    "Frame",
    "Reconstructor",
    "Recording",
    "Sheet",
    "Skin",
    "SkinError",
    "SkinWarning",
    "Touch",
    "forward",
    "load",
    "open",
    "reconstruct",
]
