"""The picture in notebooks, without a notebook: what is handed to the page."""

import threading
from collections.abc import Iterator

import numpy as np
import pytest

import skin

pytest.importorskip("anywidget")
from skin.widget import Picture, live  # noqa: E402


@pytest.fixture(scope="module")
def frames() -> list[skin.Frame]:
    unpressed = skin.forward()
    pressed = [skin.forward(touches=[(x, -20.0, 12.5, 0.2)]) for x in (30.0, -40.0)]
    return skin.reconstruct(np.array([unpressed, *pressed]), unpressed)


def test_the_page_gets_the_picture_and_the_touches(frames: list[skin.Frame]) -> None:
    picture = Picture(frames[1])
    image = np.frombuffer(picture.image, dtype="<f4").reshape(picture.shape)
    assert np.array_equal(image, frames[1].image.astype(np.float32), equal_nan=True)
    assert picture.extent_mm == list(frames[1].extent_mm)
    assert picture.most_rise == pytest.approx(np.nanmax(np.abs(frames[1].image)))
    (touch,) = picture.touches
    assert abs(touch["x_mm"] - 30) < 1 and touch["label"].endswith(" %")
    assert picture.caption == "1 touch" and picture.frame_number == 1
    picture.show(frames[0])
    assert picture.touches == [] and picture.caption == "0 touches" and picture.frame_number == 2
    # Noise stays dark.
    assert picture.most_rise == pytest.approx(0.05)
    assert "render" in str(picture._esm)


def test_it_follows_and_the_last_frame_stays(frames: list[skin.Frame]) -> None:
    picture = live(frames[1:], rate_hz=0.001)
    assert picture._thread is not None
    picture._thread.join(timeout=60)
    assert not picture.following
    # The first at once, the second since it is the last.
    assert picture.frame_number == 2 and picture.touches[0]["x_mm"] < 0


def test_it_can_be_stopped_and_goes_on(frames: list[skin.Frame]) -> None:
    given = threading.Event()

    def endless() -> Iterator[skin.Frame]:
        while True:
            given.set()
            yield frames[1]

    picture = live(endless())
    assert given.wait(timeout=60) and picture.following
    with pytest.raises(skin.SkinError, match="stop it first"):
        picture.follow(frames)
    picture.stop()
    assert not picture.following
    picture.follow(frames[:1])
    picture.stop()
    with pytest.raises(skin.SkinError, match="above 0"):
        picture.follow(frames, rate_hz=0.0)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_what_ends_the_frames_is_said() -> None:
    def broken() -> Iterator[skin.Frame]:
        raise skin.SkinError("the board is gone")
        yield

    picture = live(broken())
    picture.stop()
    assert picture.caption == "ended: the board is gone"
