"""The program that is in the package."""

import shutil
import subprocess
import sys
import sysconfig

import numpy as np
import pytest

import skin

SKIN = [sys.executable, "-m", "skin"]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*SKIN, *arguments], capture_output=True, text=True, timeout=120)


def test_it_is_the_program() -> None:
    said = run("--version")
    assert said.returncode == 0 and said.stdout.startswith("skin ")
    assert "skin reconstruct" in run("--help").stdout


def test_its_exit_codes_are_the_program_s() -> None:
    assert run("forward", "--nonsense").returncode == 2
    failed = run("forward", "--sheet", "/nowhere/sheet.toml")
    assert failed.returncode == 1
    with pytest.raises(skin.SkinError) as error:
        skin.Sheet.load("/nowhere/sheet.toml")
    assert failed.stderr.strip() == f"skin: {error.value}"


def test_it_computes_what_the_module_computes() -> None:
    table = run("forward", "--csv", "--touch", "30,-20,12.5,0.2").stdout.splitlines()[1:]
    values = np.array([float(line.split(",")[-1]) for line in table])
    assert values == pytest.approx(skin.forward(touches=[(30.0, -20.0, 12.5, 0.2)]), rel=1e-8)


@pytest.mark.skipif(
    shutil.which("skin", path=sysconfig.get_path("scripts")) is None, reason="the package is not installed by pip"
)
def test_it_is_on_the_path() -> None:
    program = shutil.which("skin", path=sysconfig.get_path("scripts"))
    assert program is not None
    said = subprocess.run([program, "--version"], capture_output=True, text=True, timeout=120)
    assert said.stdout == run("--version").stdout
