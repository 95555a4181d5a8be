"""Joint angles as files: whole or not at all, with units, signs and zero; OpenSim reads its own."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest
from imufast import InputError, write_angles, write_orientation
from imufast.io import table_files
from numpy.typing import NDArray

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def rel() -> imufast.RelativeOrientation:
    s = imufast.simulate_hinge("mixed", duration_s=20, rate_hz=50, seed=2)
    tracked = imufast.track(s.imu1, s.imu2, imufast.calibrate_joint(s.imu1, s.imu2))
    return replace(tracked, time_s=tracked.time_s + 417.0)


@pytest.fixture(scope="module")
def one(rel: imufast.RelativeOrientation) -> imufast.JointAngles:
    axis = rel.calibration.axis
    assert axis is not None
    return imufast.hinge_angle(rel, axis, flexion="axis", zero=(417.0, 418.0), zero_deg=5.0)


@pytest.fixture(scope="module")
def three(rel: imufast.RelativeOrientation) -> imufast.JointAngles:
    axis = rel.calibration.axis
    assert axis is not None
    frames = [
        imufast.segment_frame(
            "left", flexion_axis=axis, sensor=sensor, joint="knee", proximal=np.cross(vector, [0.2, 0.7, 0.4])
        )
        for sensor, vector in ((1, axis.axis1), (2, axis.axis2))
    ]
    return imufast.joint_angles(rel, frames[0], frames[1])


def storage(path: Path) -> tuple[list[str], list[str], Array]:
    """Header, labels and rows of an OpenSim file, read without it."""
    lines = path.read_text("utf-8").splitlines()
    end = lines.index("endheader")
    return (
        lines[:end],
        lines[end + 1].split("\t"),
        np.array([[float(x) for x in line.split("\t")] for line in lines[end + 2 :]]),
    )


def test_mot_holds_the_angles_alone(one: imufast.JointAngles, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_files, "ROWS", 64)
    path = tmp_path / "knee.MOT"
    write_angles(one, path, names=["-knee_angle_l"])
    head, labels, rows = storage(path)
    assert head[:5] == ["knee", "version=1", "nRows=1000", "nColumns=2", "inDegrees=yes"]
    for said in (
        "imufast.angles 1",
        "angles: knee_angle_l is minus flexion; degrees, time in s",
        "side: not told",
        "status: FOUND",
    ):
        assert said in head
    assert "zero: mean of 0 to 1 s after the start, set to 5 degrees" in head
    assert labels == ["time", "knee_angle_l"]
    np.testing.assert_array_equal(rows[:, 0], one.time_s)
    np.testing.assert_allclose(rows[:, 1], -one["flexion"], atol=1e-8)


def test_sto_holds_standard_deviations_too(three: imufast.JointAngles, tmp_path: Path) -> None:
    write_angles(three, tmp_path / "knee.sto")
    head, labels, rows = storage(tmp_path / "knee.sto")
    names = ["flexion", "adduction", "internal_rotation"]
    assert labels == ["time", *(part for name in names for part in (name, f"{name}_std"))]
    assert "nColumns=7" in head
    assert "side: left" in head
    np.testing.assert_allclose(rows[:, 1::2], three.angles_deg, atol=1e-8)
    np.testing.assert_allclose(rows[:, 2::2], three.std_deg, atol=1e-8)


def test_csv_states_units_and_keeps_the_numbers(three: imufast.JointAngles, tmp_path: Path) -> None:
    write_angles(three, tmp_path / "knee.csv", names=("a", "-b", "c"))
    first, names, *rows = (tmp_path / "knee.csv").read_text("utf-8").splitlines()
    assert first.startswith("# imufast.angles 1; angles: a is flexion, b is minus adduction, c is internal_rotation; degrees")
    for said in (
        "convention: ISB",
        "signs: clinical",
        "side: left",
        "joint: knee",
        "status: FOUND",
        "zero: the segments' axes",
    ):
        assert said in first
    assert names == "time_s,a_deg,a_std_deg,b_deg,b_std_deg,c_deg,c_std_deg,gimbal_lock"
    values = np.array([[float(x) for x in row.split(",")] for row in rows])
    np.testing.assert_array_equal(values[:, 0], three.time_s)
    np.testing.assert_allclose(values[:, [1, 3, 5]], three.angles_deg * [1, -1, 1], atol=1e-8)
    np.testing.assert_allclose(values[:, [2, 4, 6]], three.std_deg, rtol=1e-5)
    assert not values[:, 7].any()


def test_parquet_states_them_in_its_schema(one: imufast.JointAngles, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    write_angles(one, tmp_path / "knee.parquet")
    table = parquet.read_table(tmp_path / "knee.parquet")
    assert table.column_names == ["time_s", "flexion_deg", "flexion_std_deg"]
    about = json.loads(table.schema.metadata[b"imufast.angles"])
    assert about["schema_version"] == 1
    assert about["units"] == {"time_s": "s", "flexion_deg": "deg", "flexion_std_deg": "deg"}
    assert about["zero"] == one.zero
    assert table.schema.field("flexion_deg").metadata[b"unit"] == b"deg"
    np.testing.assert_array_equal(table["flexion_deg"], one["flexion"])
    np.testing.assert_array_equal(table["flexion_std_deg"], one.std_deg[:, 0])


def test_orientations_for_opensense(rel: imufast.RelativeOrientation, tmp_path: Path) -> None:
    path = tmp_path / "q.sto"
    write_orientation(rel, path, names=("femur_l_imu", "tibia_l_imu"))
    lines = path.read_text("utf-8").splitlines()
    assert lines[:3] == ["DataRate=50.000000", "DataType=Quaternion", "version=3"]
    assert lines[4:6] == ["endheader", "time\tfemur_l_imu\ttibia_l_imu"]
    cells = [line.split("\t") for line in lines[6:]]
    assert {row[1] for row in cells} == {"1.0000000000,0.0000000000,0.0000000000,0.0000000000"}
    np.testing.assert_allclose([[float(x) for x in row[2].split(",")] for row in cells], rel.q_12, atol=1e-10)


@pytest.mark.parametrize("name", ["k.mot", "k.sto", "k.csv", "k.parquet"])
def test_whole_or_not_at_all(one: imufast.JointAngles, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow.parquet")
    path = tmp_path / name
    write_angles(one, path)
    whole = path.read_bytes()

    def fail(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(InputError, match="No space left"):
        write_angles(one, path)
    assert path.read_bytes() == whole
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_other_things_and_names_are_refused(
    one: imufast.JointAngles, three: imufast.JointAngles, rel: imufast.RelativeOrientation, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"must end in \.mot, \.sto, \.csv or \.parquet"):
        write_angles(one, tmp_path / "k.txt")
    with pytest.raises(InputError, match="angles must be JointAngles"):
        write_angles(one.angles_deg, tmp_path / "k.mot")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no folder"):
        write_angles(one, tmp_path / "none" / "k.mot")
    bad: tuple[tuple[Any, str], ...] = (
        ("flexion", "names must be 1 name, got 'flexion'"),
        (["a", "b"], "names must be 1 name"),
        (["a b"], "'a b' is no name of a column"),
        (["a\tb"], "is no name of a column"),
        (["-"], "is no name of a column"),
        ([""], "is no name of a column"),
        ([3], "3 is no name of a column"),
    )
    for names, said in bad:
        with pytest.raises(InputError, match=said):
            write_angles(one, tmp_path / "k.mot", names=names)
    with pytest.raises(InputError, match="must be different names"):
        write_angles(three, tmp_path / "k.mot", names=["a", "-a", "b"])
    with pytest.raises(InputError, match="a minus turns the sign of an angle"):
        write_orientation(rel, tmp_path / "q.sto", names=("-a", "b"))
    assert not list(tmp_path.iterdir())


SCRIPT = """
import json, sys, warnings
warnings.simplefilter("ignore")
import opensim
opensim.Logger.setLevelString("Error")
angles, motion, turned = sys.argv[1:]
out = {}
for name, path in (("sto", angles), ("mot", motion)):
    table, old = opensim.TimeSeriesTable(path), opensim.Storage(path)
    labels = list(table.getColumnLabels())
    out[name] = {
        "labels": labels,
        "degrees": table.getTableMetaDataString("inDegrees"),
        "storage": [old.getSize(), old.isInDegrees()],
        "time": list(table.getIndependentColumn()),
        "values": [list(map(float, table.getDependentColumn(label).to_numpy())) for label in labels],
    }
q = opensim.TimeSeriesTableQuaternion(turned)
rows = [q.getRowAtIndex(i).getElt(0, 1) for i in range(q.getNumRows())]
out["q"] = {"labels": list(q.getColumnLabels()), "values": [[row.get(k) for k in range(4)] for row in rows]}
# A knee: the motion drives its coordinate.
model = opensim.Model()
thigh, shank = (opensim.Body(name, 1.0, opensim.Vec3(0), opensim.Inertia(1)) for name in ("thigh", "shank"))
model.addBody(thigh); model.addBody(shank)
model.addJoint(opensim.WeldJoint("hip", model.getGround(), thigh))
knee = opensim.PinJoint("knee", thigh, opensim.Vec3(0, -0.4, 0), opensim.Vec3(0), shank, opensim.Vec3(0), opensim.Vec3(0))
knee.updCoordinate().setName("knee_angle_l")
model.addJoint(knee)
model.finalizeConnections()
model.initSystem()
states = opensim.Storage(motion)
model.getSimbodyEngine().convertDegreesToRadians(states)
values = opensim.ArrayDouble()
states.getDataColumn("knee_angle_l", values)
out["radians"] = [values.get(i) for i in range(values.getSize())]
print("JSON" + json.dumps(out))
"""


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("opensim") is None, reason="opensim is missing: make test-all installs it where it can"
)
def test_opensim_reads_what_was_written(
    one: imufast.JointAngles, three: imufast.JointAngles, rel: imufast.RelativeOrientation, tmp_path: Path
) -> None:
    sto, mot, turned = tmp_path / "three.sto", tmp_path / "knee.mot", tmp_path / "q.sto"
    write_angles(three, sto)
    write_angles(one, mot, names=["-knee_angle_l"])
    write_orientation(rel, turned, names=("femur_l_imu", "tibia_l_imu"))
    command = [sys.executable, "-c", SCRIPT, str(sto), str(mot), str(turned)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("JSON"))[4:])
    assert found["mot"]["labels"] == ["knee_angle_l"]
    for name in ("mot", "sto"):
        assert found[name]["degrees"] == "yes"
        assert found[name]["storage"] == [1000, True]
        np.testing.assert_array_equal(found[name]["time"], one.time_s)
    np.testing.assert_allclose(found["mot"]["values"][0], -one["flexion"], atol=1e-8)
    np.testing.assert_allclose(np.array(found["sto"]["values"])[::2].T, three.angles_deg, atol=1e-8)
    np.testing.assert_allclose(np.array(found["sto"]["values"])[1::2].T, three.std_deg, atol=1e-8)
    assert found["q"]["labels"] == ["femur_l_imu", "tibia_l_imu"]
    np.testing.assert_allclose(found["q"]["values"], rel.q_12, atol=1e-9)
    # As the coordinate of a model, it is in radians.
    np.testing.assert_allclose(found["radians"], np.radians(-one["flexion"]), atol=1e-9)
