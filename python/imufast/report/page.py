"""The page: plain data and figures poured into the template. What comes from files is escaped by the template engine."""

from __future__ import annotations

import math
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from imufast.errors import ImufastError
from imufast.report.body_words import name_words
from imufast.report.words import UNKNOWN_DEG, duration

if TYPE_CHECKING:
    import jinja2

__all__ = ["check_extra", "html"]

LIMITLESS = ("rate_scale", "offset_prior", "lever_std", "undetermined_std")
"""Settings that may be infinite, which plain JSON holds as null."""


def check_extra(what: str = "a report") -> None:
    """Refuse with advice if matplotlib or jinja2 is missing; `what` needs them.

    Raises:
        ImufastError: one of them is.
    """
    try:
        import jinja2
        import matplotlib.figure  # noqa: F401
    except ImportError as missing:
        name = (missing.name or "matplotlib or jinja2").partition(".")[0]
        raise ImufastError(f"{what} needs {name}: pip install 'imufast[report]'") from None
    del jinja2


def html(report: dict[str, Any]) -> str:
    """The report as one page that needs nothing else."""
    check_extra()
    import jinja2

    from imufast.report.axes_figure import axis_picture
    from imufast.report.center_figure import center_picture, residual_picture
    from imufast.report.figures import timeline

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: files("imufast.report").joinpath(name).read_text(encoding="utf-8")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": _number, "duration": duration, "setting": _setting, "words": name_words}
    if "joints" in report:
        return _body_page(report, environment.get_template("body.html.j2"))
    if "curve" in report:
        return _orientation_page(report, environment.get_template("orientation.html.j2"))
    template = environment.get_template("page.html.j2")
    sensors = [
        {
            "number": i,
            "name": report["sensors"][i - 1],
            "axis": report[f"axis{i}"],
            "bound": report["bound95_deg"][i - 1] if report["bound95_deg"] else None,
            "bias_deg_s": _degrees(report[f"gyr_bias{i}_rad_s"]),
            # The one kind of text that goes into the page as it is: drawn here, from numbers alone.
            "picture": axis_picture(report, i) or "",
            "center_picture": center_picture(report, i) or "",
            "acc_bias": report[f"acc_bias{i}_m_s2"],
            "acc_bias_std": report[f"acc_bias{i}_std_m_s2"],
            **_center_mm(report["center"], i),
        }
        for i in (1, 2)
    ]
    return template.render(
        report=report,
        sensors=sensors,
        timeline=timeline(report) if report["history"]["steps"] else "",
        residual_picture=residual_picture(report) or "",
        tone=_tone(report),
        unknown_deg=UNKNOWN_DEG,
    )


def _orientation_page(report: dict[str, Any], template: jinja2.Template) -> str:
    """The page of a relative orientation."""
    from imufast.report.angle_figure import angle_picture
    from imufast.report.figures import clock_of
    from imufast.report.orientation_figure import histogram_picture, orientation_timeline

    known = report["calibration"]
    sensors = [
        {
            "name": report["sensors"][i - 1],
            "axis": known[f"axis{i}"],
            "bound": known["bound95_deg"][i - 1] if known["bound95_deg"] else None,
            "bias_deg_s": _degrees(known[f"gyr_bias{i}_rad_s"]),
            "acc_bias": known[f"acc_bias{i}_m_s2"],
            **_center_mm(known["center"], i),
        }
        for i in (1, 2)
    ]
    tones = {"TRACKED": "good", "NUMERICAL_ERROR": "bad"}
    tone = tones.get(report["status"], "open")
    if tone == "good" and report["angles"] and report["angles"]["status"] != "FOUND":
        tone = "open"
    return template.render(
        report=report,
        sensors=sensors,
        angle_picture=angle_picture(report["angles"], clock_of(report)) if report["angles"] else "",
        timeline=orientation_timeline(report) or "",
        histogram=histogram_picture(report) or "",
        tone=tone,
        unknown_deg=UNKNOWN_DEG,
    )


def _body_page(report: dict[str, Any], template: jinja2.Template) -> str:
    """The page of a lower body."""
    from imufast.report import body_figure as draw
    from imufast.report.figures import clock_of

    clock = clock_of(report)
    pictures = {
        "heading": draw.heading_picture(report, clock),
        "lengths": draw.lengths_picture(report) if report["lengths"] else "",
        "history": draw.history_picture(report) if report["history"]["cost"] else "",
    }
    if report["angles"]:
        pictures["stick"] = draw.stick_picture(report, clock)
        pictures["flexion"] = draw.flexion_picture(report, clock)
        pictures["close"] = draw.close_picture(report, clock)
    known = all(joint["determined"] for joint in report["joints"].values())
    tones = {"CONVERGED": "good" if known else "open", "NUMERICAL_ERROR": "bad", "PLACEMENT_CONTRADICTED": "bad"}
    return template.render(report=report, pictures=pictures, tone=tones.get(report["status"], "open"))


def _center_mm(center: dict[str, Any] | None, sensor: int) -> dict[str, Any]:
    """What the page says of the joint centre in numbers, mm; None where it is not known."""
    if center is None or center["in_sensor1_m"] is None:
        return {"center": None, "distance": None, "center_std": None}
    std = center["determined_std_m"]
    return {
        "center": [1e3 * value for value in center[f"in_sensor{sensor}_m"]],
        "distance": 1e3 * center["distance_m"][sensor - 1],
        "center_std": None if std is None or std[sensor - 1] is None else 1e3 * std[sensor - 1],
    }


def _tone(report: dict[str, Any]) -> str:
    if report["accepted"] is None:
        return "good" if report["center"]["status"] == "CONVERGED" else "open"
    if report["accepted"]:
        return "good"
    return "bad" if report["verdict"] in ("NOT_A_HINGE", "MOUNTING_CHANGED") else "open"


def _degrees(vector: list[float] | None) -> list[float] | None:
    return None if vector is None else [math.degrees(value) for value in vector]


def _number(value: float | None, form: str = ".3g") -> str:
    """A number for people, with a true minus sign; a dash where there is none."""
    if value is None:
        return "–"
    text = format(value, form)
    if "e+" in text and abs(value) < 1e6:
        text = format(value, "+.0f" if form.startswith("+") else ".0f")
    if not any(digit in "123456789" for digit in text):
        text = format(0.0, form).replace("+", "")
    return text.replace("-", "−")


def _setting(value: Any, name: str) -> str:
    if value is None:
        return "no limit" if name in LIMITLESS else "off"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)
