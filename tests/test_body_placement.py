"""placement.toml: what it says, and what must be refused by key and value."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest
from imufast.body import Placement, read_placement
from imufast.errors import FileFormatError, ImufastError, InputError, MissingFileError, SettingsError

LEG = '[placement]\nthigh_right = "thigh"\nshank_right = "shank"\n'


def written(folder: Path, text: str) -> Path:
    path = folder / "placement.toml"
    path.write_text(text, "utf-8")
    return path


def recording(folder: Path, **files: tuple[str, ...]) -> imufast.Recording:
    rng = np.random.default_rng(1)
    paths = []
    for file, names in files.items():
        arrays: dict[str, Any] = {f"{name}.{kind}": rng.normal(size=(50, 3)) for name in names for kind in ("gyr", "acc")}
        np.savez(folder / f"{file}.npz", rate_hz=50.0, **arrays)
        paths.append(folder / f"{file}.npz")
    with pytest.warns(imufast.ImufastWarning):
        return imufast.read(paths)


def test_segments_and_measures(tmp_path: Path) -> None:
    placement = read_placement(written(tmp_path, LEG + "[subject]\nheight_m = 1.80\nfemur_m = 0.43\ntibia_m = [0.42, 0.005]\n"))
    assert isinstance(placement, Placement)
    assert placement.files == []
    known = placement.anthropometry()
    assert known is not None
    assert known.femur_m == (0.43, 0.015)
    assert known.tibia_m == (0.42, 0.005)
    assert known.hips_m == imufast.Anthropometry.of_height(1.80).hips_m
    assert placement.anthropometry(1.80) == known
    assert placement.sensors(recording(tmp_path, leg=("thigh", "shank", "arm"))) == {
        "thigh_right": "thigh",
        "shank_right": "shank",
    }


def test_without_measures_there_is_no_anthropometry(tmp_path: Path) -> None:
    placement = read_placement(written(tmp_path, LEG))
    assert placement.anthropometry() is None
    assert placement.anthropometry(1.6) == imufast.Anthropometry.of_height(1.6)


def test_sensors_of_files_also_where_names_clash(tmp_path: Path) -> None:
    text = '[placement]\nthigh_right = { file = "one.npz" }\nshank_right = { file = "two.npz", sensor = "imu" }\n'
    placement = read_placement(written(tmp_path, text))
    assert placement.files == [tmp_path / "one.npz", tmp_path / "two.npz"]
    found = placement.sensors(recording(tmp_path, one=("imu",), two=("imu", "spare")))
    assert found == {"thigh_right": "one", "shank_right": "two.imu"}


@pytest.mark.parametrize(
    ("text", "kind", "said"),
    [
        ("", InputError, r"\[placement\] must say"),
        ("placement = 3\n", InputError, r"placement must be a table, \[placement\], got 3"),
        ("[place]\npelvis = 'a'\n", InputError, "'place' means nothing here"),
        ("[placement]\narm = 'a'\n", InputError, r"\[placement\] arm = 'a' is no segment; segments are pelvis, thigh_right"),
        ("[placement]\npelvis = 3\n", InputError, r"\[placement\] pelvis = 3 must be a sensor's name"),
        ("[placement]\npelvis = ''\n", InputError, r"pelvis = '' must be a sensor's name"),
        ("[placement]\npelvis = { path = 'a' }\n", InputError, "'path' means nothing here; there are file and sensor"),
        ("[placement]\npelvis = { file = 1 }\n", InputError, "file must be a text, got 1"),
        (LEG + "[subject]\nweight_kg = 70\n", InputError, r"\[subject\] weight_kg = 70 means nothing here; there are height_m"),
        (LEG + "[subject]\nheight_m = 178\n", SettingsError, r"\[subject\] height_m must be between 0.8 and 2.5, got 178"),
        (LEG + "[subject]\nfemur_m = 'long'\n", SettingsError, r"\[subject\] femur_m must be a number, got 'long'"),
        (LEG + "[subject]\nfemur_m = [0.4]\n", SettingsError, r"femur_m must be a length or \[mean, standard deviation\]"),
        (LEG + "[subject]\nfemur_m = [0.4, 0]\n", SettingsError, "femur_m, standard deviation, must be between 0.0001"),
        (LEG + "[subject]\nhips_m = nan\n", SettingsError, "hips_m must be between"),
        ("[placement\n", FileFormatError, "is no TOML"),
        (LEG + "thigh_right = 'again'\n", FileFormatError, "is no TOML"),
    ],
)
def test_what_means_nothing_is_refused_by_key_and_value(text: str, kind: type[ImufastError], said: str, tmp_path: Path) -> None:
    with pytest.raises(kind, match=said):
        read_placement(written(tmp_path, text))


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="no such file"):
        read_placement(tmp_path / "none.toml")
    with pytest.raises(MissingFileError):
        read_placement(tmp_path)
    (tmp_path / "raw.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="is no TOML"):
        read_placement(tmp_path / "raw.toml")


def test_sensors_that_the_recording_does_not_have(tmp_path: Path) -> None:
    rec = recording(tmp_path, one=("thigh", "shank"), two=("foot",))
    cases = {
        "pelvis = 'hip'": "pelvis = 'hip' names no sensor; there are 'thigh', 'shank', 'foot'",
        "pelvis = { file = 'three.npz' }": r"pelvis is in file .*three.npz', which was not read; read: one.npz, two.npz",
        "pelvis = { file = 'one.npz' }": "pelvis needs sensor = too, for its file holds several: there are 'thigh', 'shank'",
        "pelvis = { file = 'two.npz', sensor = 'shank' }": "pelvis = 'shank' names no sensor of .*two.npz'; there is 'foot'",
    }
    for line, said in cases.items():
        with pytest.raises(InputError, match=said):
            read_placement(written(tmp_path, f"[placement]\n{line}\n")).sensors(rec)


def test_two_heights_contradict_each_other(tmp_path: Path) -> None:
    placement = read_placement(written(tmp_path, LEG + "[subject]\nheight_m = 1.8\n"))
    with pytest.raises(InputError, match=r"height 1.7 m contradicts \[subject\] height_m = 1.8"):
        placement.anthropometry(1.7)
