"""PACP 7 tables as CSV: Inspections and Conditions, with the column names of the exchange database.

The names were taken from published imports of that database; codes come from our table and are not verified against the
licensed manual, so no conformity is claimed: column Remarks says so in each file. Lengths in metres (IsImperial 0) or feet.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence

from device.export.base import Options, day, printable
from device.inspections.codes import codes
from device.inspections.model import Inspection

_FOOT_M = 0.3048
_INCH_MM = 25.4
UNVERIFIED = "codes not verified against the PACP manual"
_MATERIAL = {
    "PVC": "PVC",
    "concrete": "CP",
    "clay": "VCP",
    "PE": "PE",
    "PP": "PP",
    "GRP": "RPM",
    "ductile iron": "DIP",
    "unknown": "ZZZ",
}
_SHAPE = {"circular": "C", "egg": "E", "oval": "O", "other": "Z"}


def pacp(inspection: Inspection, options: Options) -> dict[str, bytes]:
    """The tables by file name. Raises Invalid where the date is not known."""
    foot, inch = (_FOOT_M, _INCH_MM) if options.imperial else (1.0, 1.0)
    pipe = inspection.pipe

    def length(value: float | None) -> str:
        return "" if value is None else f"{value / foot:.2f}"

    size = "" if pipe.dn_mm is None else f"{pipe.dn_mm / inch:.0f}"
    survey = {
        "InspectionID": str(inspection.number),
        "Surveyed_By": inspection.operator,
        "Pipe_Segment_Reference": pipe.name,
        "Date": day(inspection, options).isoformat(),
        "Time": inspection.date[11:16] if inspection.date and len(inspection.date) > 10 else "",
        "Location_Details": inspection.site,
        "Upstream_MH": pipe.upstream.name,
        "Downstream_MH": pipe.downstream.name,
        "Direction": "D" if inspection.direction == "downstream" else "U",
        "Height": size,
        "Width": size if pipe.shape == "circular" else "",
        "Shape": _SHAPE.get(pipe.shape, "Z"),
        "Material": _MATERIAL.get(pipe.material, "ZZZ"),
        "Total_Length": length(pipe.length),
        "Length_Surveyed": length(inspection.length),
        "Additional_Info": UNVERIFIED,
        "IsImperial": "1" if options.imperial else "0",
        "Coordinate_System": "" if inspection.crs is None else f"EPSG:{inspection.crs}",
    }
    conditions = []
    for one in inspection.observations:
        code = codes().get(one.code)
        percent = code is not None and code.q1 == "%"
        conditions.append(
            {
                "ConditionID": str(one.number),
                "InspectionID": str(inspection.number),
                "Distance": length(one.station),
                "Counter": "",
                "PACP_Code": "" if code is None else code.pacp,
                "Continuous": one.continuous.replace("A", "S").replace("B", "F"),
                "Value_1st_Dimension": "" if one.q1 is None or percent else f"{one.q1 / inch:g}",
                "Value_2nd_Dimension": "" if one.q2 is None else f"{one.q2 / inch:g}",
                "Value_Percent": f"{one.q1:g}" if percent and one.q1 is not None else "",
                "Joint": "J" if one.at_joint else "",
                "Clock_At_From": "" if one.clock_from is None else str(one.clock_from),
                "Clock_To": "" if one.clock_to is None else str(one.clock_to),
                "Remarks": one.remark,
                "VCR_Time": "",
            }
        )
    pictures = [
        {"MediaConditionID": str(k), "ConditionID": str(one.number), "Image_Reference": one.photo, "Image_Path": "photos"}
        for k, one in enumerate((one for one in inspection.observations if one.photo), 1)
    ]
    return {
        "PACP_Inspections.csv": table(tuple(survey), [survey]),
        "PACP_Conditions.csv": table(tuple(conditions[0]) if conditions else ("ConditionID",), conditions),
        "PACP_Media_Conditions.csv": table(("MediaConditionID", "ConditionID", "Image_Reference", "Image_Path"), pictures),
    }


def table(columns: Sequence[str], rows: Sequence[Mapping[str, str]]) -> bytes:
    """CSV in UTF-8 with a header, as spreadsheets and data bases read it."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\r\n")
    writer.writeheader()
    writer.writerows({name: printable(row.get(name, "")) for name in columns} for row in rows)
    return text.getvalue().encode()
