"""Fixtures for all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings: IMUFAST_DATA, else ../shared/data beside the project; skips where it is missing."""
    folder = Path(os.environ.get("IMUFAST_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real recordings are missing: no folder {folder} (set IMUFAST_DATA)")
    return folder
