"""The report of a lower body: its plain data, its page, and the animation."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest
from body_cases import found, simulated
from imufast.body.skeleton import skeleton
from imufast.errors import ImufastError, InputError
from imufast.quaternion import matrix
from imufast.report import animation, report_json, write_animation, write_json, write_report
from imufast.report import body_words as words

pytest.importorskip("matplotlib")


def test_the_numbers_are_plain_and_complete(tmp_path: Path) -> None:
    body = found()
    plain = report_json(body, recording=simulated().recording, warnings=["look"])
    assert (plain["schema"], plain["schema_version"]) == ("imufast.body-report", 1)
    assert plain["status"] == "CONVERGED"
    assert plain["headline"] == "Pelvis and legs are known"
    assert plain["warnings"] == ["look"]
    assert plain["recording"]["rate_hz"] == 50.0
    assert [angles["joint"] for angles in plain["angles"]] == [
        *("hip_right", "hip_left", "knee_right", "knee_left", "ankle_right", "ankle_left")
    ]
    knee = plain["angles"][2]
    np.testing.assert_array_equal(knee["angles_deg"][0], body.knee_angles_deg["right"][:, 0])
    assert knee["highest_deg"][0] == body.knee_angles_deg["right"][:, 0].max()
    assert set(plain["joints"]) == set(body.joints)
    assert len(plain["lengths"]) == 5
    assert len(plain["history"]["cost"]) == body.iterations
    write_json(body, tmp_path / "body.json", max_points=100)
    thin = json.loads((tmp_path / "body.json").read_text("utf-8"))
    assert len(thin["angles"][0]["time_s"]) <= 100
    assert thin["angles"][0]["highest_deg"] == plain["angles"][0]["highest_deg"]


def test_residuals_are_those_of_noise_where_nothing_contradicts() -> None:
    residuals = found().residuals
    assert set(residuals) == {
        *("dynamics", "gyr_bias_walk", "acc_bias_walk", "joint_center", "hinge", "knee_axes"),
        *("segment_length", "axis_angle", "length_difference"),
    }
    assert set(residuals["hinge"]) == {"knee_right", "knee_left"}
    assert set(residuals["joint_center"]) == set(found().joints)
    assert all(abs(value) < 2.5 for values in residuals.values() for value in values.values())
    assert report_json(found())["residual_words"] == []


def test_swapped_shanks_and_a_wrong_height_raise_their_own_residuals() -> None:
    truth = simulated()
    tall = imufast.estimate_lower_body(truth.recording, truth.placement, imufast.Anthropometry.of_height(2.3))
    assert min(abs(value) for value in list(tall.residuals["segment_length"].values())[:4]) > 2.5
    assert "length against the usual one" in " ".join(report_json(tall)["residual_words"])
    placement = truth.placement | {"shank_left": "shank_right", "shank_right": "shank_left"}
    swapped = imufast.estimate_lower_body(truth.recording, placement)
    for joint in ("knee_right", "knee_left", "ankle_right", "ankle_left"):
        assert swapped.residuals["joint_center"][joint] > 10.0 * found().residuals["joint_center"][joint]
    assert "joint centre, as both sensors see it: right knee" in " ".join(report_json(swapped)["residual_words"])


def test_the_page_needs_nothing_else_and_escapes_what_it_is_told(tmp_path: Path) -> None:
    write_report(
        found(), tmp_path / "a.html", recording=simulated().recording, title="<b>Walk</b> & 'co'", warnings=["<i>w</i>"]
    )
    page = (tmp_path / "a.html").read_text("utf-8")
    assert "&lt;b&gt;Walk&lt;/b&gt; &amp;" in page
    assert "<i>w</i>" not in page
    for part in ("The subject at a few moments", "Flexion over the recording", "All angles from near", "Lengths", "The search"):
        assert f"<h2>{part}</h2>" in page
    assert page.count("<svg") == 6
    assert not re.search(r"(?:src|href)\s*=\s*[\"'](?!#)", page)
    ids = re.findall(r'\sid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    assert "Nothing contradicts what was assumed" in page
    write_report(
        found(), tmp_path / "b.html", recording=simulated().recording, title="<b>Walk</b> & 'co'", warnings=["<i>w</i>"]
    )
    assert (tmp_path / "b.html").read_bytes() == (tmp_path / "a.html").read_bytes()


def test_what_is_open_is_said_in_words(tmp_path: Path) -> None:
    truth = imufast.simulate_lower_body("ankles_and_knees", seed=1, duration_s=45.0, gyr_bias=0.005, acc_bias=0.05)
    body = imufast.estimate_lower_body(truth.recording, truth.placement)
    write_report(body, tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text("utf-8")
    assert "Pelvis and legs are known, but for what the motion leaves open." in page
    assert "but not those of right hip" in page
    assert "✗ open" in page
    assert 'class="verdict open"' in page


def test_where_every_joint_is_open_nothing_is_called_known() -> None:
    body = found()
    lost = replace(body, joints={name: replace(joint, determined=False) for name, joint in body.joints.items()})
    assert words.headline(lost) == "The motion leaves every joint open"
    assert "this motion settles no joint" in words.advice(lost)
    odd = replace(body, residuals=body.residuals | {"hinge": {"knee_left": 4.0}})
    assert "Something contradicts" in words.advice(odd)
    assert "Something contradicts" not in words.advice(replace(body, residuals={}))


def test_unknown_bands_and_a_search_cut_short_still_make_a_page(tmp_path: Path) -> None:
    body = found()
    unknown: dict[str, Any] = {
        f"{kind}_std_deg": {side: np.full_like(std, np.inf) for side, std in getattr(body, f"{kind}_std_deg").items()}
        for kind in ("hip", "knee", "ankle")
    }
    cut: Any = replace(body, status=imufast.BodyStatus.MAX_ITERATIONS, residuals={}, history=body.history[:1], **unknown)
    write_report(cut, tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text("utf-8")
    assert "The search ran out of iterations." in page
    assert "How well it fits" not in page
    json.dumps(report_json(cut), allow_nan=False)


@pytest.mark.parametrize(
    "missing",
    [
        ("foot_left", "foot_right"),
        ("pelvis", "thigh_left", "shank_left", "foot_left"),
        ("thigh_left", "shank_left", "foot_left"),
    ],
)
def test_smaller_models_make_a_page_and_a_figure(missing: tuple[str, ...], tmp_path: Path) -> None:
    body = found(*missing)
    write_report(body, tmp_path / "a.html")
    drawn = skeleton(body)
    assert all(np.isfinite(place).all() for place in drawn.points.values())
    assert {end for ends in drawn.bones.values() for end in ends} <= set(drawn.points)
    assert bool(drawn.assumed) == (missing[0] != "thigh_left")
    write_animation(body, tmp_path / "a.gif", span_s=(0.0, 1.0))


def test_the_stick_figure_keeps_lengths_and_angles() -> None:
    body, truth = found(), simulated()
    drawn = skeleton(body)
    for side in ("right", "left"):
        hip, knee, ankle = (drawn.points[f"{joint}_{side}"] for joint in ("hip", "knee", "ankle"))
        thigh, shank = knee - hip, ankle - knee
        np.testing.assert_allclose(np.linalg.norm(thigh, axis=1), body.lengths_m[f"femur_{side}"][0], rtol=1e-6)
        between = np.einsum("ki,ki->k", thigh, shank)
        bent = np.degrees(np.arccos(between / np.linalg.norm(thigh, axis=1) / np.linalg.norm(shank, axis=1)))
        rows = body.knee_angles_deg[side][:, 0] > 30.0
        np.testing.assert_allclose(bent[rows], body.knee_angles_deg[side][rows, 0], atol=4.0)
        # Where the true joints are, the heading aside: heights.
        at = np.searchsorted(truth.time_s, body.time_s - 1e-9)
        true = truth.joint_position[f"hip_{side}"] - truth.joint_position[f"ankle_{side}"]
        np.testing.assert_allclose((hip - ankle)[:, 2], true[at, 2], atol=0.04)
    assert min(float(place[:, 2].min()) for place in drawn.points.values()) == pytest.approx(0.0, abs=1e-9)
    # The subject faces along y, right is to the right.
    ahead = matrix(body.q_segment["pelvis"])[:, :2, 1]
    across = drawn.points["hip_right"] - drawn.points["hip_left"]
    assert np.linalg.norm(ahead, axis=1).min() > 0.1
    assert (across[:, 0] > 0.1).all()


def test_two_legs_without_a_pelvis_stand_beside_each_other() -> None:
    body = found()
    parts: dict[str, Any] = {
        name: {key: value for key, value in getattr(body, name).items() if not key.startswith(("pelvis", "hip"))}
        for name in ("q", "q_segment", "joints")
    }
    drawn = skeleton(replace(body, **parts))
    across = drawn.points["hip_right"] - drawn.points["hip_left"]
    np.testing.assert_allclose(across[:, 0], body.anthropometry.hips_m[0], atol=1e-9)
    assert drawn.assumed >= {"hip_right", "hip_left"}


def test_a_shank_without_its_knee_hangs_below_the_other_hip() -> None:
    body = found("pelvis", "thigh_left")
    points = skeleton(body).points
    assert float((points["knee_left"] - points["hip_right"])[:, 2].max()) < -0.3
    assert words.headline(body).startswith("The legs are known")


def test_a_gap_is_no_line_and_no_picture() -> None:
    truth = simulated()
    keep = (truth.time_s < 11.0) | (truth.time_s > 13.0)
    imus = {name: imufast.Imu(truth.gyr[name][keep], truth.acc[name][keep], time_s=truth.time_s[keep]) for name in truth.gyr}
    recording = imufast.Recording({name: imu._replace(name=name) for name, imu in imus.items()})
    body = imufast.estimate_lower_body(recording, truth.placement)
    plain = report_json(body)
    assert plain["gaps_s"]["count"] == 1
    assert plain["gaps_s"]["total_s"] == pytest.approx(2.0, abs=0.3)
    times = animation._times(body, (10.0, 14.0), 10.0)
    assert not ((times > 11.05) & (times < 12.95)).any()
    assert len(times) > 15


def test_the_animation_runs_in_real_time_and_moves(tmp_path: Path) -> None:
    from PIL import Image

    done: list[tuple[int, int]] = []
    path = tmp_path / "a.gif"
    write_animation(found(), path, title="A $walk", span_s=(8.0, 10.0), progress=lambda *now: done.append(now))
    with Image.open(path) as film:
        assert film.n_frames == 21
        assert film.info["duration"] == 100
        pictures = []
        for k in (0, 10):
            film.seek(k)
            pictures.append(np.asarray(film.convert("RGB"), dtype=np.int64))
    assert (pictures[0][0, 0] == 255).all()
    assert (np.abs(pictures[0] - pictures[1]).max(axis=2) > 100).sum() > 300
    assert done[-1] == (21, 21)
    write_animation(found(), tmp_path / "b.gif", title="A $walk", span_s=(8.0, 10.0))
    assert (tmp_path / "b.gif").read_bytes() == path.read_bytes()


def test_an_mp4_by_ffmpeg(tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    write_animation(found(), tmp_path / "a.mp4", span_s=(8.0, 9.0))
    count, seconds = ffmpeg.count_frames_and_secs(str(tmp_path / "a.mp4"))
    assert (count, seconds) == (26, pytest.approx(1.04, abs=0.05))
    assert [file.name for file in tmp_path.iterdir()] == ["a.mp4"]


def test_a_file_for_the_rerun_viewer(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    done: list[tuple[int, int]] = []
    write_animation(found(), tmp_path / "a.rrd", title="walk", span_s=(8.0, 9.0), progress=lambda *k: done.append(k))
    written = (tmp_path / "a.rrd").read_bytes()
    assert written.startswith(b"RRF2")
    assert done[-1] == (51, 51)
    assert [file.name for file in tmp_path.iterdir()] == ["a.rrd"]
    # One second of 51 places and 18 angles is tens of kB, and twice as long about twice as much.
    write_animation(found(), tmp_path / "b.rrd", span_s=(8.0, 10.0))
    assert len(written) < (tmp_path / "b.rrd").stat().st_size < 3 * len(written)


def test_without_rerun_it_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    with pytest.raises(ImufastError, match=r"an \.rrd needs rerun-sdk: pip install 'imufast\[rerun\]'"):
        write_animation(found(), tmp_path / "a.rrd")
    assert not list(tmp_path.iterdir())


def test_without_ffmpeg_it_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda _: None)
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(ImufastError, match=r"an \.mp4 needs ffmpeg: install it, or pip install 'imufast\[animate\]'"):
        write_animation(found(), tmp_path / "a.mp4")
    assert not list(tmp_path.iterdir())


def test_an_ffmpeg_that_fails_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tool = tmp_path / "ffmpeg"
    tool.write_text("#!/bin/sh\necho 'Unknown encoder libx264' >&2\nexit 1\n")
    tool.chmod(0o755)
    monkeypatch.setattr(animation, "_ffmpeg", lambda: str(tool))
    (tmp_path / "a.mp4").write_text("before")
    with pytest.raises(ImufastError, match="Unknown encoder libx264"):
        write_animation(found(), tmp_path / "a.mp4", span_s=(8.0, 9.0))
    assert (tmp_path / "a.mp4").read_text() == "before"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.mp4", "ffmpeg"]


def test_a_stopped_animation_leaves_nothing(tmp_path: Path) -> None:
    class EnoughError(Exception):
        pass

    def stop(*_: int) -> None:
        raise EnoughError

    names = ("a.gif", "a.mp4") if shutil.which("ffmpeg") or _has_imageio() else ("a.gif",)
    for name in names:
        with pytest.raises(EnoughError):
            write_animation(found(), tmp_path / name, span_s=(8.0, 9.0), progress=stop)
    assert not list(tmp_path.iterdir())


def _has_imageio() -> bool:
    import importlib.util

    return importlib.util.find_spec("imageio_ffmpeg") is not None


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"span_s": (2.0, 1.0)}, "span_s must be two times from 0 to"),
        ({"span_s": (0.0, 1e6)}, "span_s must be two times from 0 to"),
        ({"span_s": 3.0}, "span_s must be two times"),
        ({"span_s": (0.0, float("nan"))}, "span_s must be two times"),
        ({"title": 3}, "title must be a text"),
    ],
)
def test_a_bad_animation_is_refused(arguments: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        write_animation(found(), tmp_path / "a.gif", **arguments)
    with pytest.raises(InputError, match=r"must end in \.gif, \.mp4 or \.rrd"):
        write_animation(found(), tmp_path / "a.avi")
    with pytest.raises(InputError, match="body must be a LowerBody"):
        write_animation(3, tmp_path / "a.gif")  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_another_recording_is_refused(tmp_path: Path) -> None:
    truth = simulated()
    some = imufast.Recording({"pelvis": truth.recording["pelvis"]})
    with pytest.raises(InputError, match="has no sensor 'thigh_right'"):
        write_report(found(), tmp_path / "a.html", recording=some)
    pair = (truth.recording["pelvis"], truth.recording["foot_left"])
    with pytest.raises(InputError, match="recording must be the Recording of all sensors"):
        report_json(found(), recording=pair)
