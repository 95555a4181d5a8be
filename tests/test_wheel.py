"""What a wheel holds, and what it must not."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    beside = Path(sys.executable).parent / "maturin"
    maturin = str(beside) if beside.is_file() else shutil.which("maturin")
    if maturin is None:
        pytest.skip("maturin is missing: pip install 'imufast[dev]'")
    out = tmp_path_factory.mktemp("wheel")
    done = subprocess.run(
        [maturin, "build", "--release", "--locked", "--interpreter", sys.executable, "--out", str(out)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (built,) = out.glob("*.whl")
    return built


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_wheel_holds_the_package_and_nothing_else(wheel: Path) -> None:
    assert "-cp310-abi3-" in wheel.name
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    info = next(name for name in names if name.endswith(".dist-info/METADATA")).partition("/")[0]
    for name in ("imufast/py.typed", "imufast/_core.pyi", "imufast/__init__.py", "imufast/cli/__init__.py"):
        assert name in names
    assert sum(name.startswith("imufast/_core") and name.endswith((".so", ".pyd")) for name in names) == 1
    for licence in ("LICENSE-MIT", "LICENSE-APACHE"):
        assert f"{info}/licenses/{licence}" in names
    strangers = [name for name in names if not name.startswith(("imufast/", f"{info}/"))]
    assert not strangers
    assert not [name for name in names if "test" in name.lower() or name.endswith((".rs", ".pyc", ".npz"))]
    # Every module of the source tree is there.
    for module in (ROOT / "python" / "imufast").rglob("*.py"):
        assert module.relative_to(ROOT / "python").as_posix() in names


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_metadata_promises_numpy_alone_and_the_extras(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        name = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        lines = archive.read(name).decode().splitlines()
    required = [line.partition(": ")[2] for line in lines if line.startswith("Requires-Dist: ")]
    assert [line for line in required if "extra ==" not in line] == [line for line in required if line.startswith("numpy")]
    extras = {line.partition(": ")[2] for line in lines if line.startswith("Provides-Extra: ")}
    assert {"cli", "report", "io", "bench", "dev"} <= extras
    assert "Requires-Python: >=3.10" in lines
    assert "License-Expression: MIT OR Apache-2.0" in lines
