"""What the extension module has. Arrays are float64 unless another type is said."""

from collections.abc import Iterator, Sequence
from os import PathLike
from types import TracebackType
from typing import Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
    "program",
    "reconstruct",
]

_Order = Literal["adjacent16", "pyeit", "pyeit-fmmu", "eidors", "eidors-rotated", "openeit"]
_Method = Literal["nnls", "lawson-hanson", "tikhonov", "pseudo-inverse"]
_Rise = Literal["up", "down", "either"]
_Drive = Literal["voltage", "current"]
_Disc = tuple[float, float, float, float]
"""A disc that presses: centre x and y and radius, mm, and relative rise of resistivity there, above -1 (0.2 is +20 %)."""

class SkinError(Exception):
    """What went wrong, and what to do about it, in the program's own words."""

class SkinWarning(UserWarning):
    """What there is to say beside the frames: of the baseline, of the line to the board."""

@final
class Touch:
    """Where the sheet is pressed, and by how much its resistivity rises there."""

    @property
    def id(self) -> int | None:
        """Number that stays with the touch from frame to frame; None before its third frame, and where frames have nothing to do
        with each other."""
    @property
    def x_mm(self) -> float:
        """Centre, mm to the right of the sheet's origin."""
    @property
    def y_mm(self) -> float:
        """Centre, mm above the sheet's origin."""
    @property
    def rise(self) -> float:
        """Relative change of resistivity at the centre: 0.2 is +20 %, negative where it falls."""
    @property
    def at_limit(self) -> bool:
        """Whether the rise is the largest or the smallest that the model of discs has: it is at least so large, or so small."""
    @property
    def area_mm2(self) -> float:
        """Area that is pressed, mm²."""
    @property
    def total_mm2(self) -> float:
        """Rise integrated over the area, mm²."""
    @property
    def x_sd_mm(self) -> float | None:
        """Standard uncertainty of x_mm; None where the touch is a peak of the picture only."""
    @property
    def y_sd_mm(self) -> float | None:
        """Standard uncertainty of y_mm; None where the touch is a peak of the picture only."""
    @property
    def area_sd_mm2(self) -> float | None:
        """Standard uncertainty of area_mm2, or None."""
    @property
    def total_sd_mm2(self) -> float | None:
        """Standard uncertainty of total_mm2, or None."""
    @property
    def force_n(self) -> float | None:
        """Force, N; None where nothing tells it."""
    @property
    def uncalibrated(self) -> bool:
        """Whether the force is that of a typical rubber, without a calibration."""

@final
class Frame:
    """One measured frame, and what was found in it."""

    @property
    def sequence(self) -> int:
        """The board's number of the frame; for reconstruct the frame's place, from 0."""
    @property
    def time_s(self) -> float | None:
        """The board's time, s; for reconstruct the place times frame_s, or None."""
    @property
    def values(self) -> NDArray[np.float64]:
        """Measured values, V (or the unit that was given), shape (values,); NaN where the converter clipped."""
    @property
    def touches(self) -> tuple[Touch, ...]:
        """Touches, strongest first."""
    @property
    def image(self) -> NDArray[np.float64]:
        """Relative rise of resistivity, shape (rows, columns), row 0 lowest; NaN off the sheet. With Matplotlib:
        ``imshow(frame.image, origin="lower", extent=frame.extent_mm)``."""
    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of the image, mm."""
    @property
    def doubt(self) -> str | None:
        """What speaks against the touches, or None."""
    @property
    def notice(self) -> str | None:
        """What drifted since the baseline and was taken out, or None."""
    @property
    def changed(self) -> bool:
        """Whether there was a change above the noise."""
    @property
    def used(self) -> int:
        """How many values took part."""
    @property
    def residual(self) -> float:
        """Part of the change that the picture leaves unexplained, 0 to 1."""
    @property
    def explained(self) -> float | None:
        """Part of the change that the touches take, where they do not explain the frame."""
    @property
    def compute_us(self) -> float | None:
        """For reconstruct and recordings: time that the frame took in Rust alone, microseconds. Of a board it would be waiting."""

@final
class Press:
    """A press that was located by what others taught."""

    @property
    def x_mm(self) -> float:
        """Place, mm, in the coordinates of the presses that were learned from."""
    @property
    def y_mm(self) -> float:
        """Place, mm, in the coordinates of the presses that were learned from."""
    @property
    def x_sd_mm(self) -> float:
        """Standard uncertainty of x_mm."""
    @property
    def y_sd_mm(self) -> float:
        """Standard uncertainty of y_mm."""
    @property
    def strength(self) -> float:
        """Strength over the usual one of the presses that were learned from."""
    @property
    def strength_sd(self) -> float:
        """Standard uncertainty of the strength."""

@final
class Presses:
    """The presses that were located in a frame."""

    @property
    def presses(self) -> tuple[Press, ...]:
        """Presses, strongest first; empty where there is none."""
    @property
    def explained(self) -> float:
        """Part of the change that they explain, 0 to 1."""
    @property
    def misfit(self) -> float:
        """Mean square of what they leave, in variances of the presses that were learned from; near 1 where they explain the frame."""
    @property
    def doubt(self) -> str | None:
        """What speaks against them, or None."""

@final
class PressCalibration:
    """What presses at known places taught of a real skin. It never changes."""

    @staticmethod
    def load(path: str | PathLike[str]) -> PressCalibration:
        """Reads a file of ``skin calibrate presses`` or of save."""
    def save(self, path: str | PathLike[str]) -> None:
        """Writes it as a file, for ``skin run --calibration`` and skin.open(calibration=...)."""
    def locate(
        self,
        values: ArrayLike,
        unpressed: ArrayLike | None = None,
        *,
        sheet: Sheet | None = None,
        order: _Order | None = None,
    ) -> list[Presses]:
        """The presses of frames, in order of time: what a press leaves behind is taken from the next one.

        values, unpressed: shapes and unit as of calibrate_presses; without unpressed the values are changes.
        sheet, order: how the values are laid, where it is not as in calibrate_presses, or for a file as in measurements.
        """
    @property
    def presses(self) -> int:
        """Presses that it was made of."""
    @property
    def error_mm(self) -> float:
        """Distance at which presses are located by what the others taught, mm: median."""
    @property
    def error_95th_percentile_mm(self) -> float | None:
        """The same: 95th percentile; None of a file."""
    @property
    def explained(self) -> float | None:
        """Part of the change that what other presses taught explains, 0 to 1; None of a file."""
    @property
    def gross(self) -> list[int]:
        """Presses that nothing explains, by their numbers from 0: they were left out. None of a file are known."""
    @property
    def missed(self) -> list[int]:
        """Presses that are not found by what the others taught, by their numbers from 0. None of a file are known."""
    @property
    def measurements(self) -> NDArray[np.int64]:
        """What the values of a frame are, shape (values, 4): drive_a, drive_b, sense_a, sense_b, electrodes from 1."""

@final
class Sheet:
    """A conductive sheet with its electrodes, and what is measured on it. It never changes."""

    @staticmethod
    def load(path: str | PathLike[str]) -> Sheet:
        """Reads a sheet's file (TOML)."""
    @staticmethod
    def parse(text: str) -> Sheet:
        """Reads a sheet's text (TOML)."""
    @staticmethod
    def paper() -> Sheet:
        """A disc of 195 mm with 16 electrodes of 10 mm, and neighbouring pairs: the default everywhere."""
    @staticmethod
    def disc(
        diameter_mm: float,
        electrodes: int,
        electrode_mm: float,
        *,
        contact_mm: float = 1.0,
        sheet_resistance_ohm: float = 1000.0,
    ) -> Sheet:
        """A disc with evenly spaced electrodes, the first at +x, counter-clockwise, and neighbouring pairs."""
    @property
    def electrodes(self) -> int:
        """How many electrodes it has."""
    @property
    def electrodes_mm(self) -> NDArray[np.float64]:
        """Centres of the electrodes, mm, shape (electrodes, 2)."""
    @property
    def outline_mm(self) -> NDArray[np.float64]:
        """The rim as a polygon, mm, shape (points, 2)."""
    @property
    def measurements(self) -> NDArray[np.int64]:
        """What the values of a frame are, shape (values, 4): drive_a, drive_b, sense_a, sense_b, electrodes from 1. The current
        enters at drive_a; the value is U(sense_b) - U(sense_a)."""
    @property
    def text(self) -> str:
        """The sheet as TOML; its measurements are not in it."""

@final
class Reconstructor:
    """What finds touches in frames, one after another, by one baseline."""

    def __new__(
        cls,
        baseline: ArrayLike,
        *,
        sheet: Sheet | None = None,
        order: _Order | None = None,
        method: _Method = "nnls",
        rise: _Rise | None = None,
        drive: _Drive = "voltage",
        frame_s: float | None = None,
        trust_electrodes: bool = False,
    ) -> Reconstructor:
        """Models the sheet and takes the baseline; see reconstruct for the arguments."""
    def frame(self, values: ArrayLike) -> Frame:
        """The touches of one frame, shape (values,)."""
    def frames(self, values: ArrayLike) -> list[Frame]:
        """The touches of frames, shape (frames, values), in their order."""
    @property
    def electrodes_mm(self) -> NDArray[np.float64]:
        """Centres of the electrodes as the baseline showed them, mm, shape (electrodes, 2)."""

@final
class Skin:
    """Frames of a board, of the simulated skin or of a recording: an iterator, and a context manager that closes it.

    Several threads may take frames; each frame goes to one of them. In a process that was forked off it raises SkinError.
    """

    @property
    def name(self) -> str:
        """Where the frames come from."""
    @property
    def closed(self) -> bool:
        """Whether it is closed."""
    def tare(self) -> None:
        """Takes a new baseline from the next frame on; nothing may touch the sheet for a second. Not of a recording."""
    def close(self) -> None:
        """Closes the port. A thread that waits for a frame gets none any more. Closing twice is no error."""
    def __iter__(self) -> Skin: ...
    def __next__(self) -> Frame: ...
    def __enter__(self) -> Skin: ...
    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None: ...

@final
class Recording:
    """A recording in memory."""

    @property
    def source(self) -> str:
        """Where its frames came from."""
    @property
    def started_unix_s(self) -> float:
        """When it was begun, s since 1970 (UTC)."""
    @property
    def sheet(self) -> Sheet:
        """The sheet, with what was measured on it."""
    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times of the frames since the first one, s, shape (frames,)."""
    @property
    def sequences(self) -> NDArray[np.uint32]:
        """The board's numbers of the frames, uint32, shape (frames,)."""
    @property
    def values(self) -> NDArray[np.float64]:
        """Values, V, shape (frames, values); NaN where the converter clipped."""
    @property
    def baseline(self) -> NDArray[np.int64]:
        """Places of the frames that made the first baseline, int64; empty where not all of them are known."""
    @property
    def touches(self) -> tuple[tuple[Touch, ...] | None, ...]:
        """The touches that were found then, for every frame; None for a frame that was not shown."""
    def __len__(self) -> int: ...

def open(
    source: str | PathLike[str] | None = None,
    *,
    simulate: bool = False,
    scene: str | PathLike[str] | None = None,
    serial: str | None = None,
    sheet: Sheet | None = None,
    plan: str = "auto",
    baseline_frames: int | None = None,
    rise: _Rise | None = None,
    trust_electrodes: bool = False,
    every_frame: bool = False,
    wires: Sequence[int] | None = None,
    calibration: str | PathLike[str] | None = None,
    state_dir: str | PathLike[str] | None = None,
) -> Skin:
    """Opens a source of frames.

    source: a serial port, ``tcp://HOST:PORT``, or a recording (``.mcap``); None for the only board on USB.
    simulate: the simulated skin with its demo, in real time. scene: the same with a scene's file or name.
    serial: serial number of the board, for one of several.
    sheet: what is wired to the board; None for Sheet.paper(), or the scene's.
    plan: what a frame measures: "auto", or a name as of ``skin run --plan``.
    baseline_frames: frames of the unpressed sheet that are averaged at the start, 2 or more; None for those of 0.7 s.
    every_frame: every frame, however late, up to 64 MB of them; else those too late are passed over.
    wires: the electrode that every wire leads to, from 1.
    calibration: what ``skin calibrate`` or ``skin calibrate presses`` wrote; None for what they stored for this board, which is said as a
        SkinWarning, and "none" for none. state_dir: the folder of what is stored, as of ``skin run --state-dir``.

    Nothing may touch the sheet of a board in the first second: its baseline is taken. Of a recording the frames are those that
    were shown then, as fast as they are read; it says its sheet and all else itself.
    """

def forward(
    sheet: Sheet | None = None, touches: Sequence[Touch | _Disc] | None = None, *, drive: _Drive = "voltage"
) -> NDArray[np.float64]:
    """The frame of a touched sheet, simulated by finite elements: shape (values,), V; with drive="current" ohm."""

def reconstruct(
    values: ArrayLike,
    baseline: ArrayLike,
    *,
    sheet: Sheet | None = None,
    order: _Order | None = None,
    method: _Method = "nnls",
    rise: _Rise | None = None,
    drive: _Drive = "voltage",
    frame_s: float | None = None,
    trust_electrodes: bool = False,
) -> list[Frame]:
    """Touches of frames, measured by whatever hardware.

    values: shape (frames, values) or (values,), any unit; of complex numbers the magnitudes are taken, NaN is a missing value.
    baseline: the unpressed sheet, shape (frames, values) or (values,), the same unit; eight frames or more tell the noise.
    sheet: what was measured; None for Sheet.paper().
    order: the program whose order the values have (docs/tables.md); None for that of sheet.measurements.
    method: how the picture is computed. rise: which way touches change the resistance; None where the frames tell.
    drive: how the sheet was driven.
    frame_s: time from a frame to the next, s, where they follow one another.
    trust_electrodes: take the electrodes to be where the sheet says, instead of finding them in the baseline.
    """

def calibrate_presses(
    values: ArrayLike,
    places_mm: ArrayLike,
    unpressed: ArrayLike | None = None,
    *,
    sheet: Sheet | None = None,
    order: _Order | None = None,
) -> PressCalibration:
    """Learns what presses at known places do to the values of a real skin; five presses are the fewest.

    values: shape (presses, values), any unit, in order of time; NaN is a missing value.
    places_mm: where each pressed, mm, shape (presses, 2).
    unpressed: the frame just before each press, shape (presses, values), or one for all, shape (values,), the same unit; without it
        the values are changes, pressed less unpressed.
    sheet: what was measured, and by what turns the sheet is mapped onto itself; None for Sheet.paper(). Its model is not used.
    order: the program whose order the values have (docs/tables.md); None for that of sheet.measurements.
    """

def load(path: str | PathLike[str]) -> Recording:
    """Reads a recording: ``FILE``, or ``FILE#NAME`` for one of several skins."""

def program(arguments: Sequence[str]) -> int:
    """The program with a command line, its own name first; its exit code."""
