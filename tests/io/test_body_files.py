"""A lower body's angles as files: names, signs, what they say of themselves; and OpenSim itself reading them."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from body_cases import found
from imufast.errors import InputError
from imufast.io import write_angles
from imufast.quaternion import matrix
from numpy.typing import NDArray

NAMES = [
    *("pelvis_tilt", "pelvis_list"),
    *("hip_flexion_r", "hip_adduction_r", "hip_rotation_r", "knee_angle_r", "knee_adduction_r", "knee_rotation_r"),
    *("ankle_angle_r", "ankle_inversion_r", "ankle_rotation_r"),
    *("hip_flexion_l", "hip_adduction_l", "hip_rotation_l", "knee_angle_l", "knee_adduction_l", "knee_rotation_l"),
    *("ankle_angle_l", "ankle_inversion_l", "ankle_rotation_l"),
]


def opensim_table(path: Path) -> tuple[str, list[str], NDArray[np.float64]]:
    head, _, body = path.read_text("utf-8").partition("endheader\n")
    lines = body.splitlines()
    return head, lines[0].split("\t"), np.array([[float(x) for x in line.split("\t")] for line in lines[1:]])


def test_a_motion_has_all_angles_of_both_sides(tmp_path: Path) -> None:
    body = found()
    write_angles(body, tmp_path / "walk.mot")
    head, names, rows = opensim_table(tmp_path / "walk.mot")
    assert names == ["time", *NAMES]
    assert "inDegrees=yes" in head
    for said in ("imufast.body-angles 1", "knee_angle_l is left knee flexion", "status: CONVERGED", "undetermined: none"):
        assert said in head
    np.testing.assert_allclose(rows[:, 0], body.time_s)
    np.testing.assert_allclose(rows[:, 1:3], body.pelvis_angles_deg, atol=1e-8)
    for side, first in (("right", 3), ("left", 12)):
        for kind in ("hip", "knee", "ankle"):
            np.testing.assert_allclose(rows[:, first : first + 3], getattr(body, f"{kind}_angles_deg")[side], atol=1e-8)
            first += 3
    assert np.ptp(rows[:, names.index("knee_angle_r")]) > 60.0


def test_storage_has_bands_and_names_may_be_others(tmp_path: Path) -> None:
    body = found()
    names = {"knee_angle_r": "-knee_angle_r", "knee_angle_l": "-kneeL"}
    write_angles(body, tmp_path / "walk.sto", names=names)
    head, labels, rows = opensim_table(tmp_path / "walk.sto")
    assert len(labels) == 1 + 2 * len(NAMES)
    assert "knee_angle_r is minus right knee flexion" in head
    np.testing.assert_allclose(rows[:, labels.index("kneeL")], -body.knee_angles_deg["left"][:, 0], atol=1e-8)
    np.testing.assert_allclose(rows[:, labels.index("kneeL_std")], body.knee_std_deg["left"][:, 0], atol=1e-8)


def test_tables_state_units_and_frames(tmp_path: Path) -> None:
    body = found()
    write_angles(body, tmp_path / "walk.csv")
    first, names, *rows = (tmp_path / "walk.csv").read_text("utf-8").splitlines()
    assert first.startswith("# imufast.body-angles 1; angles: ")
    assert {part.split(": ")[0] for part in first[2:].split("; ")[1:]} >= {"std", "signs", "frames", "zero", "placement"}
    assert names.split(",")[:3] == ["time_s", "pelvis_tilt_deg", "pelvis_tilt_std_deg"]
    assert len(rows) == len(body.time_s)
    parquet = pytest.importorskip("pyarrow.parquet")
    write_angles(body, tmp_path / "walk.parquet")
    table = parquet.read_table(tmp_path / "walk.parquet")
    about = json.loads(table.schema.metadata[b"imufast.body-angles"])
    assert about["schema_version"] == 1
    assert about["units"]["hip_rotation_l_std_deg"] == "deg"
    assert "knee axis" in about["frames"]
    assert table.schema.field("hip_adduction_l_deg").metadata[b"description"] == b"left hip adduction"
    np.testing.assert_array_equal(table["hip_adduction_l_deg"].to_numpy(), body.hip_angles_deg["left"][:, 1])


def test_a_smaller_model_has_fewer_columns(tmp_path: Path) -> None:
    body = found("pelvis", "thigh_left", "shank_left", "foot_left")
    write_angles(body, tmp_path / "leg.mot", names={"knee_angle_l": "left", "knee_angle_r": "right"})
    _, names, _ = opensim_table(tmp_path / "leg.mot")
    assert names == ["time", "right", *NAMES[6:8], *NAMES[8:11]]


def test_what_is_not_known_is_half_a_turn_wide(tmp_path: Path) -> None:
    body = found()
    unknown = replace(body, knee_std_deg={side: np.full_like(std, np.inf) for side, std in body.knee_std_deg.items()})
    write_angles(unknown, tmp_path / "walk.sto")
    _, labels, rows = opensim_table(tmp_path / "walk.sto")
    assert (rows[:, labels.index("knee_angle_r_std")] == 180.0).all()


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ("knee_angle_r", "names must map columns"),
        (["a"] * 20, "names must map columns"),
        ({"knee": "a"}, "no column 'knee'"),
        ({"knee_angle_r": "hip_flexion_r"}, "different names"),
        ({"knee_angle_r": "a b"}, "'a b' is no name"),
        ({"knee_angle_r": 3}, "3 is no name"),
    ],
)
def test_names_that_are_none_are_refused(names: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        write_angles(found(), tmp_path / "walk.mot", names=names)
    assert not list(tmp_path.iterdir())


SCRIPT = """
import json, sys
import opensim
opensim.Logger.setLevelString("Error")
# Pelvis and thighs with the axes of gait2392 and of Rajagopal's model: Z, X, Y, of the left hip the last two mirrored.
model = opensim.Model()
bodies = {name: opensim.Body(name, 1.0, opensim.Vec3(0), opensim.Inertia(1)) for name in ("pelvis", "femur_r", "femur_l")}
for body in bodies.values():
    model.addBody(body)
def joint(name, parent, child, names, axes):
    turning = opensim.SpatialTransform()
    for k, (coordinate, axis) in enumerate(zip(names, axes)):
        turn = turning.updTransformAxis(k)
        turn.setCoordinateNames(opensim.ArrayStr(coordinate, 1))
        turn.setAxis(opensim.Vec3(*axis))
        turn.set_function(opensim.LinearFunction())
    return opensim.CustomJoint(name, parent, child, turning)
coordinates = {
    "pelvis": ("pelvis_tilt", "pelvis_list", "pelvis_rotation"),
    "femur_r": ("hip_flexion_r", "hip_adduction_r", "hip_rotation_r"),
    "femur_l": ("hip_flexion_l", "hip_adduction_l", "hip_rotation_l"),
}
usual, mirrored = ((0, 0, 1), (1, 0, 0), (0, 1, 0)), ((0, 0, 1), (-1, 0, 0), (0, -1, 0))
model.addJoint(joint("root", model.getGround(), bodies["pelvis"], coordinates["pelvis"], usual))
for side, axes in (("r", usual), ("l", mirrored)):
    name = f"femur_{side}"
    model.addJoint(joint(f"hip_{side}", bodies["pelvis"], bodies[name], coordinates[name], axes))
model.finalizeConnections()
state = model.initSystem()
table = opensim.TimeSeriesTable(sys.argv[1])
labels = list(table.getColumnLabels())
storage = opensim.Storage(sys.argv[1])
model.getSimbodyEngine().convertDegreesToRadians(storage)
out = {"labels": labels, "rows": table.getNumRows(), "turned": {name: [] for name in bodies}}
columns = {}
for label in labels:
    values = opensim.ArrayDouble()
    storage.getDataColumn(label, values)
    columns[label] = [values.get(i) for i in range(values.getSize())]
for row in range(0, table.getNumRows(), 20):
    for name in sum(coordinates.values(), ()):
        model.getCoordinateSet().get(name).setValue(state, columns[name][row] if name in columns else 0.0, False)
    model.realizePosition(state)
    for name, body in bodies.items():
        turn = body.getTransformInGround(state).R()
        out["turned"][name].append([[turn.get(i, j) for j in range(3)] for i in range(3)])
print("JSON" + json.dumps(out))
"""


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("opensim") is None, reason="opensim is missing: make test-all installs it where it can"
)
def test_a_model_in_opensim_moves_as_the_subject(tmp_path: Path) -> None:
    body = found()
    path = tmp_path / "walk.mot"
    write_angles(body, path)
    done = subprocess.run([sys.executable, "-c", SCRIPT, str(path)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("JSON"))[4:])
    assert told["labels"] == NAMES
    assert told["rows"] == len(body.time_s)
    # ISB's X, Y, Z are McGrath's y, z, x.
    to_mcgrath = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    ours = {name: matrix(body.q_segment[name][::20]) @ to_mcgrath for name in ("pelvis", "thigh_right", "thigh_left")}
    turned = {name: np.array(value) for name, value in told["turned"].items()}
    for name, segment in (("femur_r", "thigh_right"), ("femur_l", "thigh_left")):
        theirs = np.swapaxes(turned["pelvis"], 1, 2) @ turned[name]
        np.testing.assert_allclose(theirs, np.swapaxes(ours["pelvis"], 1, 2) @ ours[segment], atol=1e-7)
    # OpenSim's Y is up: what is up in the pelvis is the same, whatever the heading.
    np.testing.assert_allclose(turned["pelvis"][:, 1], ours["pelvis"][:, 2], atol=1e-7)
