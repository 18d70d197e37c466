"""The report as a PDF: cover, pipe sketch, observations with photos, diameter sheets, deviations, landmarks, what was refused.

Built by reportlab with the fonts that every PDF reader has, so that it is small and needs nothing from the network.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any
from xml.sax.saxutils import escape

from reportlab.graphics.shapes import Circle, Drawing, Line, Polygon, PolyLine, Rect, String
from reportlab.lib import colors
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle, getSampleStyleSheet
from reportlab.lib.units import mm
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import Flowable, Image, KeepTogether, PageBreak, Paragraph, SimpleDocTemplate, Spacer, Table, TableStyle

from device.export.base import Options, printable
from device.export.chambers import node_name, pipes_of
from device.export.deviation_drawings import score_drawing, wall_drawing
from device.export.wording import WORDS, reason
from device.inspections.codes import codes
from device.inspections.model import AnomalySheet, DiameterSheet, Inspection, Observation

_FOOT_M, _INCH_MM = 0.3048, 25.4
_WIDTH = A4[0] - 36 * mm
_INK, _GREY, _LINE = colors.HexColor("#12333f"), colors.HexColor("#5b6b72"), colors.HexColor("#c9d3d7")
_GOOD, _BAD, _WATER = colors.HexColor("#1b7a43"), colors.HexColor("#b3261e"), colors.HexColor("#9cc7e6")
_MOST_SKETCHED = 40
"""Observations beside the sketch; in a longer list the labels would lie on each other, and the table has them all."""


def pdf(inspection: Inspection, options: Options) -> bytes:
    """The file. Needs no date: what is not known is said to be."""
    words = WORDS[options.language]
    pages: list[Flowable] = [
        *_cover(inspection, options, words),
        *_sketch(inspection, options, words),
        *_observations(inspection, options, words),
        *_diameters(inspection, options, words),
        *_anomalies(inspection, options, words),
        *_landmarks(inspection, options, words),
        *_chambers(inspection, words),
        *_instruments(inspection, words),
        *_refused(inspection, options, words),
    ]
    file = io.BytesIO()
    title = f"{words['report']}: {inspection.pipe.name}"
    document = SimpleDocTemplate(
        file,
        pagesize=A4,
        leftMargin=18 * mm,
        rightMargin=18 * mm,
        topMargin=16 * mm,
        bottomMargin=18 * mm,
        title=title,
        author=options.program,
        invariant=1,
    )
    foot = _foot(title, words)
    document.build(pages, onFirstPage=foot, onLaterPages=foot)
    return file.getvalue()


def _foot(title: str, words: dict[str, str]) -> Callable[[Canvas, SimpleDocTemplate], None]:
    def draw(canvas: Canvas, document: SimpleDocTemplate) -> None:
        canvas.setFont("Helvetica", 8)
        canvas.setFillColor(_GREY)
        canvas.drawString(18 * mm, 10 * mm, printable(title))
        canvas.drawRightString(A4[0] - 18 * mm, 10 * mm, f"{words['page']} {document.page}")

    return draw


_BASE = getSampleStyleSheet()
_TITLE = ParagraphStyle("title", _BASE["Title"], alignment=0, textColor=_INK, fontSize=22, leading=26)
_HEAD = ParagraphStyle("head", _BASE["Heading2"], textColor=_INK, spaceBefore=10, spaceAfter=4)
_TEXT = ParagraphStyle("text", _BASE["BodyText"], fontSize=9, leading=12)
_SMALL = ParagraphStyle("small", _TEXT, fontSize=8, leading=10)


def _paragraph(text: str, style: ParagraphStyle = _TEXT) -> Paragraph:
    return Paragraph(escape(printable(text)), style)


def _cover(inspection: Inspection, options: Options, words: dict[str, str]) -> list[Flowable]:
    pipe = inspection.pipe
    date = (inspection.date or "")[:16].replace("T", " ")
    rows = [
        (words["site"], inspection.site),
        (words["pipe"], pipe.name),
        (words["from"], pipe.upstream.name),
        (words["to"], pipe.downstream.name),
        (words["direction"], words[inspection.direction]),
        (words["date"], date or words["unknown"]),
        (words["operator"], inspection.operator or words["unknown"]),
        (words["method"], words[inspection.method]),
        (words["material"], pipe.material),
        (words["shape"], pipe.shape),
        (words["dn"], words["unknown"] if pipe.dn_mm is None else f"DN {pipe.dn_mm}"),
        (words["length"], _metres(pipe.length, options, words)),
        (words["inspected"], _metres(inspection.length, options, words)),
        (words["note"], inspection.note),
        (words["device"], options.program),
    ]
    summary = [
        _paragraph(f"{words['diameter']}: {_millimetres(s.diameter_mm, options, words)}, {words[s.verdict]}", _TEXT)
        for s in inspection.diameters
    ]
    return [
        _paragraph(words["report"], _TITLE),
        _table([(name, value) for name, value in rows if value], (45 * mm, _WIDTH - 45 * mm), head=False),
        Spacer(1, 4 * mm),
        *summary,
    ]


def _sketch(inspection: Inspection, options: Options, words: dict[str, str]) -> list[Flowable]:
    """The pipe from its start node downwards on the page, with each observation at its station."""
    length = inspection.length or inspection.pipe.length or max((o.station for o in inspection.observations), default=0.0)
    if length <= 0:
        return []
    height, x = 150 * mm, 40 * mm
    drawing = Drawing(_WIDTH, height + 16 * mm)
    top, bottom = height + 6 * mm, 8 * mm
    drawing.add(Rect(x - 4 * mm, bottom, 8 * mm, top - bottom, fillColor=colors.HexColor("#eef2f3"), strokeColor=_INK))
    for node, y in ((inspection.start, top), (inspection.end, bottom)):
        drawing.add(Circle(x, y, 6 * mm, fillColor=colors.white, strokeColor=_INK, strokeWidth=1.2))
        drawing.add(String(x - 8 * mm, y - 3, printable(node.name)[:18], textAnchor="end", fontSize=9, fillColor=_INK))

    def at(station: float) -> float:
        return float(top - (top - bottom) * min(max(station / length, 0.0), 1.0))

    _marks(drawing, inspection.observations, x, at, options)
    labelled = inspection.observations[:_MOST_SKETCHED]
    free = top + 4 * mm
    for one in labelled:
        y = min(at(one.station), free)
        free = y - 10.5
        label = f"{_station(one.station, options)}  {_code(one)}  {_wording(one, options)}"
        drawing.add(Line(x + 4 * mm, at(one.station), x + 14 * mm, y, strokeColor=_GREY, strokeWidth=0.4))
        drawing.add(String(x + 15 * mm, y - 3, printable(label)[:78], fontSize=8, fillColor=_INK))
    return [PageBreak(), _paragraph(words["sketch"], _HEAD), drawing]


def _marks(
    drawing: Drawing, observations: Sequence[Observation], x: float, at: Callable[[float], float], options: Options
) -> None:
    begun: dict[str, Observation] = {}
    for one in observations:
        if one.code in ("BCD", "BCE", "BDB", "BDC"):
            continue
        y = at(one.station)
        if one.continuous.startswith("A"):
            begun[one.continuous[1:]] = one
        elif one.continuous.startswith("B") and one.continuous[1:] in begun:
            first = at(begun.pop(one.continuous[1:]).station)
            drawing.add(Rect(x - 2 * mm, y, 4 * mm, first - y, fillColor=colors.HexColor("#d9b38c"), strokeColor=None))
        elif one.code == "BCA":
            side = -1 if one.clock_from is not None and one.clock_from > 6 else 1
            drawing.add(Line(x + side * 4 * mm, y, x + side * 8 * mm, y + 3 * mm, strokeColor=_INK, strokeWidth=2))
        else:
            drawing.add(Line(x - 4 * mm, y, x + 4 * mm, y, strokeColor=_BAD, strokeWidth=1.4))


def _observations(inspection: Inspection, options: Options, words: dict[str, str]) -> list[Flowable]:
    if not inspection.observations:
        return [_paragraph(words["observations"], _HEAD), _paragraph(words["none"])]
    head = [words[k] for k in ("number", "station", "code", "text", "clock", "size", "photo")]
    rows = [
        (
            str(one.number),
            _station(one.station, options),
            _code(one),
            ", ".join(part for part in (_wording(one, options), one.remark) if part),
            _clock(one),
            _size(one, options),
            one.photo,
        )
        for one in inspection.observations
    ]
    widths = [w * mm for w in (9, 18, 20, 66, 14, 17, 30)]
    found: list[Flowable] = [PageBreak(), _paragraph(words["observations"], _HEAD), _table([tuple(head), *rows], widths)]
    photos = [(one, inspection.photo(one.photo)) for one in inspection.observations if one.photo]
    shown = [(one, photo) for one, photo in photos if photo is not None]
    if shown:
        found.append(_paragraph(words["photos"], _HEAD))
        cells: list[Any] = []
        for one, photo in shown:
            caption = f"{one.number}: {_station(one.station, options)} {_code(one)} {_wording(one, options)} ({photo.name})"
            cells.append([_image(photo.jpeg, 82 * mm, 62 * mm), _paragraph(caption, _SMALL)])
        for k in range(0, len(cells), 2):
            pair = cells[k : k + 2] + [""] * (2 - len(cells[k : k + 2]))
            found.append(KeepTogether(Table([pair], colWidths=[_WIDTH / 2, _WIDTH / 2])))
    return found


def _diameters(inspection: Inspection, options: Options, words: dict[str, str]) -> list[Flowable]:
    found: list[Flowable] = []
    for sheet in inspection.diameters:
        low_high = sheet.interval_mm
        interval = "-" if low_high is None else " – ".join(_millimetres(value, options, words) for value in low_high)
        reasons = " ".join(reason(code, options.language) for code in sheet.reasons)
        rows = [
            (words["verdict"], words[sheet.verdict]),
            (words["mean"], _millimetres(sheet.diameter_mm, options, words)),
            (words["interval"], interval),
            (words["minimum"], _millimetres(sheet.minimum_mm, options, words)),
            (words["maximum"], _millimetres(sheet.maximum_mm, options, words)),
            (words["ovality"], "-" if sheet.ovality is None else f"{100 * sheet.ovality:.1f} %"),
            ("DN", sheet.dn or "-"),
            (words["position"], sheet.position or "-"),
            (words["station"], "-" if sheet.station is None else _station(sheet.station, options)),
            (words["reasons"], reasons or "-"),
        ]
        table = _table(rows, (42 * mm, 52 * mm), head=False)
        drawing = _cross_section(sheet, words)
        found.append(
            KeepTogether(
                [
                    _paragraph(words["diameter"], _HEAD),
                    Table(
                        [[table, drawing]], colWidths=[98 * mm, _WIDTH - 98 * mm], style=[("VALIGN", (0, 0), (-1, -1), "TOP")]
                    ),
                    *([] if len(sheet.frames_mm) < 2 else [_paragraph(words["frames"], _SMALL), _box_plot(sheet, options)]),
                ]
            )
        )
    return [PageBreak(), *found] if found else []


def _cross_section(sheet: DiameterSheet, words: dict[str, str]) -> Drawing:
    side = 68 * mm
    drawing = Drawing(side, side + 10 * mm)
    if sheet.diameter_mm is None:
        return drawing
    centre, scale = side / 2, 0.42 * side / max(sheet.maximum_mm or sheet.diameter_mm, sheet.diameter_mm) * 2
    radius = sheet.diameter_mm / 2 * scale
    if sheet.water_mm:
        level = max(-1.0, min(1.0, 1 - 2 * sheet.water_mm / sheet.diameter_mm))
        first = math.asin(level)
        arc = [first + k * (math.pi - 2 * first) / 40 for k in range(41)]
        points = [v for a in arc for v in (centre + radius * math.cos(a), centre - radius * math.sin(a) + 8 * mm)]
        drawing.add(Polygon(points, fillColor=_WATER, strokeColor=None))
    drawing.add(Circle(centre, centre + 8 * mm, radius, fillColor=None, strokeColor=_GREY, strokeDashArray=[3, 2]))
    for run in _runs(sheet.profile_mm):
        points = [v for x, y in run for v in (centre + x * scale, centre - y * scale + 8 * mm)]
        drawing.add(PolyLine(points, strokeColor=_GOOD if sheet.verdict == "accept" else _BAD, strokeWidth=1.6))
    drawing.add(String(0, 1 * mm, f"{words['measured']}, {words['circle']} (- -)", fontSize=7, fillColor=_GREY))
    return drawing


def _runs(profile: Sequence[tuple[float, float] | None]) -> list[list[tuple[float, float]]]:
    """The stretches of wall that were seen, closed where it was seen all around."""
    if profile and all(point is not None for point in profile):
        whole = [point for point in profile if point is not None]
        return [[*whole, whole[0]]]
    runs: list[list[tuple[float, float]]] = [[]]
    for point in profile:
        if point is None:
            runs.append([])
        else:
            runs[-1].append(point)
    return [run for run in runs if len(run) > 1]


def _box_plot(sheet: DiameterSheet, options: Options) -> Drawing:
    """Smallest, quartiles, median and largest diameter of the single frames, on the scale of the 95 % interval."""
    ordered = sorted(sheet.frames_mm)
    low, first, median, third, high = (ordered[round(share * (len(ordered) - 1))] for share in (0, 0.25, 0.5, 0.75, 1))
    ends = [low, high] if sheet.interval_mm is None else [low, high, *sheet.interval_mm]
    left, right = min(ends), max(ends)
    drawing = Drawing(_WIDTH, 19 * mm)
    span = max(right - left, 1e-6)

    def x(value: float) -> float:
        return float(12 * mm + (value - left) / span * (_WIDTH - 24 * mm))

    def label(value: float, height: float) -> String:
        text = f"{value / _INCH_MM:.2f} in" if options.imperial else f"{value:.1f}"
        return String(x(value), height, text, fontSize=7, textAnchor="middle", fillColor=_GREY)

    y = 9 * mm
    drawing.add(Line(x(left), y, x(right), y, strokeColor=_LINE))
    for value in (left, right):
        drawing.add(Line(x(value), y - 1.5 * mm, x(value), y + 1.5 * mm, strokeColor=_GREY))
        drawing.add(label(value, 2 * mm))
    drawing.add(Line(x(low), y, x(high), y, strokeColor=_INK))
    drawing.add(Rect(x(first), y - 2.5 * mm, max(x(third) - x(first), 0.5), 5 * mm, fillColor=_LINE, strokeColor=_INK))
    drawing.add(Line(x(median), y - 2.5 * mm, x(median), y + 2.5 * mm, strokeColor=_BAD, strokeWidth=1.5))
    drawing.add(label(median, y + 4 * mm))
    return drawing


def _anomalies(inspection: Inspection, options: Options, words: dict[str, str]) -> list[Flowable]:
    """Each scan with its picture and its unrolled wall, the score along the pipe, and every region."""
    if not inspection.anomalies and not inspection.scans:
        return []
    found: list[Flowable] = [_paragraph(words["anomalies"], _HEAD)]
    for sheet in inspection.scans:
        if sheet.verdict == "accept":
            found.append(KeepTogether(_scan(sheet, inspection, options, words)))
    chart = score_drawing(inspection.bands, words, _WIDTH)
    if chart is not None:
        found.append(KeepTogether([_paragraph(words["score"], _SMALL), chart]))
    head = tuple(words[k] for k in ("number", "station", "class", "clock", "peak", "area", "belief"))
    rows = [
        (
            f"{one['survey']}.{one['number']}" if "survey" in one else "-",
            "-" if one.get("chainage_m") is None else _station(float(one["chainage_m"]), options),
            words.get(str(one.get("kind")), "-") + (f" ({words['expected']})" if one.get("expected") else ""),
            _hour(one.get("clock")),
            "-" if one.get("peak_mm") is None else f"{float(one['peak_mm']):+.0f} mm",
            "-" if one.get("area_mm2") is None else f"{float(one['area_mm2']) / 100:.0f} cm2",
            "-" if one.get("confidence") is None else f"{100 * float(one['confidence']):.0f} %",
        )
        for one in inspection.anomalies
    ]
    if rows:
        found.append(_table([head, *rows], [w * mm for w in (16, 22, 46, 18, 24, 26, 22)]))
    return found


def _scan(sheet: AnomalySheet, inspection: Inspection, options: Options, words: dict[str, str]) -> list[Flowable]:
    stands = words["unknown"] if sheet.station is None else _station(sheet.station, options)
    scores = [
        f"{words[word]} {'-' if value is None else f'{value:.2f} mm'}"
        for word, value in (("inwards", sheet.score_mm), ("outwards", sheet.outward_mm))
    ]
    facts = f"{words['survey']} {sheet.survey}, {words['station']} {stands}: {', '.join(scores)}, {100 * sheet.coverage:.0f} %"
    half = _WIDTH / 2 - 3 * mm
    picture, wall = inspection.photo(sheet.picture), inspection.photo(sheet.wall)
    regions = [one for one in inspection.anomalies if one.get("survey") == sheet.survey]
    cells = [
        "" if picture is None else _image(picture.jpeg, half, 0.62 * half),
        "" if wall is None else wall_drawing(sheet, wall.jpeg, regions, half),
    ]
    pictures = Table([cells], colWidths=[_WIDTH / 2, _WIDTH / 2], style=[("VALIGN", (0, 0), (-1, -1), "TOP")])
    return [_paragraph(facts), pictures, _paragraph(words["wall_key"], _SMALL)]


def _uncertainty(landmark: Mapping[str, Any]) -> str:
    """Twice the sigma of that end of a landmark which is known less well."""
    sigmas = [landmark.get(f"sigma_chainage{end}_m") for end in ("", "_to")]
    known = [float(sigma) for sigma in sigmas if sigma is not None]
    return f"± {2 * max(known):.2f} m" if known else "-"


def _landmarks(inspection: Inspection, options: Options, words: dict[str, str]) -> list[Flowable]:
    if not inspection.landmarks:
        return []
    head = tuple(words[k] for k in ("station", "class", "clock", "uncertainty", "status"))
    rows = [
        (
            _station(float(one["chainage_m"]), options),
            str(one["class"]),
            _hour(one.get("clock")),
            _uncertainty(one),
            str(one.get("decision") or one.get("status") or ""),
        )
        for one in sorted(inspection.landmarks, key=lambda one: float(one["chainage_m"]))
    ]
    return [_paragraph(words["landmarks"], _HEAD), _table([head, *rows], [35 * mm] * 5)]


def _chambers(inspection: Inspection, words: dict[str, str]) -> list[Flowable]:
    """Each chamber: how much was found, whether to rely on it, and every object with its pipes."""
    pages: list[Flowable] = []
    for one in inspection.structures:
        name = f"{words['chamber']} {node_name(one)}, {words['survey']} {one['survey_id']}"
        counts = [f"{len(one['pipes'])} {words['pipes']}", f"{len(one['objects'])} {words['objects']}"]
        head = tuple(words[k] for k in ("number", "class", "belief", "place", "pipes"))
        rows = [
            (
                str(thing["number"]),
                thing["class"] + {True: f", {words['open']}", False: f", {words['closed']}", None: ""}[thing["open"]],
                f"{100 * thing['belief']:.0f} %",
                " ".join(f"{value:.2f}" for value in thing["position"]) + " m",
                pipes_of(one, thing),
            )
            for thing in one["objects"]
        ]
        pages += [_paragraph(name, _HEAD), _paragraph(", ".join([*counts, f"{one['summary'].get('scans', 0)} scans"]))]
        if not one["consistent"]:
            pages.append(_paragraph(words["contradicted"]))
        pages.append(_table([head, *rows], [16 * mm, 44 * mm, 24 * mm, 54 * mm, 34 * mm]))
    return pages


_KINDS = {"diameter": "diameter", "landmarks": "landmarks", "anomaly": "anomalies", "structure": "chamber"}


def _instruments(inspection: Inspection, words: dict[str, str]) -> list[Flowable]:
    if not inspection.instruments:
        return []
    rows = [
        (
            f"{words[_KINDS[one.kind]]}, {words['survey']} {one.survey}",
            one.sensor or words["unknown"],
            "; ".join(f"{words[name]} {value}" for name, value in one.calibration.items()) or "-",
        )
        for one in inspection.instruments
    ]
    head = (words["survey"], words["sensor"], words["calibration"])
    return [_paragraph(words["instruments"], _HEAD), _table([head, *rows], (60 * mm, 50 * mm, _WIDTH - 110 * mm))]


def _refused(inspection: Inspection, options: Options, words: dict[str, str]) -> list[Flowable]:
    refused = [
        f"{words['diameter']}, {words['survey']} {sheet.survey}: "
        + (" ".join(reason(code, options.language) for code in sheet.reasons) or words["by_operator"])
        for sheet in inspection.diameters
        if sheet.verdict != "accept"
    ]
    refused += [
        f"{words['anomalies']}, {words['survey']} {sheet.survey}: "
        + (" ".join(reason(code, options.language) for code in sheet.reasons) or words["by_operator"])
        for sheet in inspection.scans
        if sheet.verdict != "accept"
    ]
    return [_paragraph(words["refused"], _HEAD), *(_paragraph(line) for line in refused or [words["nothing_refused"]])]


def _table(rows: Sequence[Sequence[str]], widths: Sequence[float], head: bool = True) -> Table:
    cells = [[_paragraph(cell, _SMALL) for cell in row] for row in rows]
    style = [
        ("LINEBELOW", (0, 0), (-1, -1), 0.4, _LINE),
        ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ("TOPPADDING", (0, 0), (-1, -1), 2),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 2),
    ]
    if head:
        style.append(("BACKGROUND", (0, 0), (-1, 0), colors.HexColor("#e4ebee")))
    return Table(cells, colWidths=list(widths), repeatRows=1 if head else 0, style=TableStyle(style), hAlign="LEFT")


def _image(jpeg: bytes, width: float, height: float) -> Flowable:
    """The photo within a box; a photo that cannot be read leaves its place empty, the report goes out."""
    try:
        picture = Image(io.BytesIO(jpeg), lazy=0)
    except OSError:
        return Spacer(width, height)
    scale = min(width / picture.imageWidth, height / picture.imageHeight)
    picture.drawWidth, picture.drawHeight = scale * picture.imageWidth, scale * picture.imageHeight
    return picture


def _code(one: Observation) -> str:
    return " ".join(part for part in (one.code, one.ch1, one.ch2, one.continuous) if part)


def _wording(one: Observation, options: Options) -> str:
    code = codes().get(one.code)
    return "" if code is None else code.text(options.language)


def _hour(clock: float | None) -> str:
    """A clock position to a tenth; what rounds to 0 is 12."""
    return "-" if clock is None else f"{round(float(clock), 1) or 12.0:.1f}"


def _clock(one: Observation) -> str:
    if one.clock_from is None:
        return ""
    return str(one.clock_from) if one.clock_to is None else f"{one.clock_from}–{one.clock_to}"


def _size(one: Observation, options: Options) -> str:
    code = codes().get(one.code)
    if one.q1 is None or code is None or code.q1 is None:
        return ""
    if code.q1 == "%":
        return f"{one.q1:g} %"
    return f"{one.q1 / _INCH_MM:.2f} in" if options.imperial else f"{one.q1:g} mm"


def _station(metres: float, options: Options) -> str:
    return f"{metres / _FOOT_M:.1f} ft" if options.imperial else f"{metres:.2f} m"


def _metres(metres: float | None, options: Options, words: dict[str, str]) -> str:
    return words["unknown"] if metres is None else _station(metres, options)


def _millimetres(value: float | None, options: Options, words: dict[str, str]) -> str:
    if value is None or not math.isfinite(value):
        return words["unknown"]
    return f"{value / _INCH_MM:.2f} in" if options.imperial else f"{value:.1f} mm"
