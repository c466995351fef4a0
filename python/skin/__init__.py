"""A tactile skin read by electrical impedance tomography, in Python.

The first touch, without a board::

    import skin

    for frame in skin.open(simulate=True):
        for touch in frame.touches:
            print(touch.id, touch.x_mm, touch.y_mm, touch.force_n)

Frames of other hardware: :func:`reconstruct`. A simulated frame: :func:`forward`. A recording in memory: :func:`load`.
A real skin, from presses at known places: :func:`calibrate_presses`. A live picture in a notebook: ``skin.widget.live``.
Lengths are mm from the sheet's origin, times s, values V. All that takes long runs without the interpreter's lock.
"""

from ._skin import (
    Frame,
    Press,
    PressCalibration,
    Presses,
    Reconstructor,
    Recording,
    Sheet,
    Skin,
    SkinError,
    SkinWarning,
    Touch,
    calibrate_presses,
    forward,
    load,
    open,
    reconstruct,
)

__all__ = [
    "Frame",
    "Press",
    "PressCalibration",
    "Presses",
    "Reconstructor",
    "Recording",
    "Sheet",
    "Skin",
    "SkinError",
    "SkinWarning",
    "Touch",
    "calibrate_presses",
    "forward",
    "load",
    "open",
    "reconstruct",
]
