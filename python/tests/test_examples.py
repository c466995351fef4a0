"""The examples that need no other package, and that for Rerun where its package is."""

import importlib
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import skin

EXAMPLES = Path(__file__).parents[1] / "examples"
CONTRIB = Path(__file__).parents[2] / "contrib"


def example(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    return importlib.import_module(name)


@pytest.fixture(scope="module")
def frames() -> list[skin.Frame]:
    """Frames of a finger that comes down, however long they take."""
    taken: list[skin.Frame] = []
    pressed = 0
    with skin.open(scene="one-touch", every_frame=True) as source:
        for frame in source:
            taken.append(frame)
            pressed += any(touch.id is not None for touch in frame.touches)
            if pressed == 20:
                return taken
    raise AssertionError("the scene has no end")


def test_point_sets_are_displacements_and_forces_in_the_link(
    frames: list[skin.Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    module = example("point_set", monkeypatch)
    plain = module.point_sets(frames, 2, np.zeros(3), module.rotation(0.0, 0.0, 0.0))
    sets, where = plain["observation.tactile"], plain["observation.tactile.position"]
    there = np.isfinite(sets[:, 0, 0])
    assert there.sum() == 20 and not there.all() and np.isnan(sets[~there]).all()
    assert (np.diff(plain["timestamp"]) > 0).all() and sets.shape[1:] == (2, 6) and sets.dtype == np.float32
    # What is not measured is zero: indentation and shear. A touch begins where it came down.
    assert (sets[there, 0, 2:5] == 0).all() and (sets[there, 0, 5] < 0).all()
    assert (sets[np.argmax(there), 0, :3] == 0).all()
    last = frames[-1].touches[0]
    assert where[-1, 0] == pytest.approx([1e-3 * last.x_mm, 1e-3 * last.y_mm, 0.0], rel=1e-5)
    assert sets[-1, 0, 5] == pytest.approx(-(last.force_n or 0.0), rel=1e-5)
    # The skin on the link's side, where its normal z is the link's y, and its y points down: lengths and forces stay.
    turned = module.point_sets(frames, 2, np.array([0.0, 100.0, 0.0]), module.rotation(-90.0, 0.0, 0.0))
    side, place = turned["observation.tactile"], turned["observation.tactile.position"]
    assert side[there, 0, 4] == pytest.approx(sets[there, 0, 5], rel=1e-5)
    assert side[there, 0, 2] == pytest.approx(-sets[there, 0, 1], abs=1e-6)
    assert place[there, 0, 0] == pytest.approx(where[there, 0, 0], abs=1e-6)
    assert place[there, 0, 1] == pytest.approx(np.full(20, 0.1), abs=1e-6)
    assert place[there, 0, 2] == pytest.approx(-where[there, 0, 1], abs=1e-6)
    features = json.loads(json.dumps(module.features(2)))
    assert features["observation.tactile"]["shape"] == [2, 6] and "not measured" in features["observation.tactile"]["unknown"]


def printed(file: Path) -> str:
    """What Rerun reads in a file."""
    command = [sys.executable, "-m", "rerun", "rrd", "print", str(file)]
    said = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert said.returncode == 0, said.stderr
    return said.stdout


def test_rerun_gets_picture_touches_and_forces(
    frames: list[skin.Frame], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    rerun = pytest.importorskip("rerun")
    module = example("rerun_live", monkeypatch)
    file = tmp_path / "skin.rrd"
    rerun.init("skin")
    rerun.save(str(file))
    for frame in frames:
        module.log(frame)
    rerun.disconnect()
    layout = tmp_path / "skin.rbl"
    subprocess.run([sys.executable, CONTRIB / "rerun_layout.py", layout], check=True, timeout=300)
    said = printed(file)
    for entity in ("/skin/picture", "/skin/touches", "/force/touch1"):
        assert entity in said
    # The layout is of the same application, and shows what is logged.
    laid = printed(layout)
    assert '"skin"' in laid and "/view/" in laid and "ViewBlueprint" in laid
