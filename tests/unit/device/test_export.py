"""Exchange files: valid where there is a schema, read back by somebody else's reader where there is one."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import zipfile
from dataclasses import replace
from datetime import date
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pyogrio
import pytest
import shapely
import trimesh
from hypothesis import HealthCheck, given, settings
from pypdf import PdfReader

from device.errors import Invalid
from device.export.base import Options, printable
from device.export.en13508 import en13508, observations_of, read
from device.export.formats import NAMES, export, files
from device.export.isybau import NAMESPACE, isybau
from device.export.wording import REASONS_DE, reason
from device.inspections.model import Inspection, Observation
from device.prompts import PROMPTS
from tests.unit.device.inspections import any_inspection, whole

OPTIONS = Options(made=date(2026, 6, 2))
SPACE = {"i": NAMESPACE}
SAMPLE = """#A1=ISO-8859-1
#A2=de
#A3=,
#A4=.
#A5="
#A6=2010
#B01=ACC,ACB,ABC,ABA,ABQ,AAD,AAB,AAK,AAF,ABF,ABG,ABH,AAA
400,400,A,EN 13508-2:2003+A1:2011,23.5,6,2925,A,2925,2007-07-19,09:05,N. N.,1
#C=I,N,A,B,C,D,G,H,K,F,M,J
0,,BCD,X,P,2925,,,,,,
4.4,,BAB,B,A,2,12,,,"a, b",6,A1
5.4,,BAB,B,A,2,12,,A,,,B1
23.5,,BCE,X,P,6,,,,,,
#Z
"""
"""Laid out as the published example of the package kwb.en13508.2 (inst/extdata/example_13508_2.txt)."""


@pytest.fixture(scope="session")
def schema(data_dir: Path):  # type: ignore[no-untyped-def]
    """The official schema, where the shared data are there."""
    etree = pytest.importorskip("lxml.etree")
    return etree.XMLSchema(etree.parse(data_dir / "isybau" / "1302-metadaten.xsd"))


def zustaende(xml: bytes) -> list[Observation]:
    """The observations of an ISYBAU file, by a reader of its own."""
    found = []
    for number, one in enumerate(ElementTree.fromstring(xml).iterfind(".//i:RZustand", SPACE), 1):
        text = {child.tag.removeprefix(f"{{{NAMESPACE}}}"): child.text or "" for child in one}
        hours = [int(text[name]) if name in text else None for name in ("PositionVon", "PositionBis")]
        found.append(
            Observation(
                float(text["Station"]),
                text["InspektionsKode"],
                text.get("Charakterisierung1", ""),
                text.get("Charakterisierung2", ""),
                float(text["Quantifizierung1Numerisch"]) if "Quantifizierung1Numerisch" in text else None,
                None,
                hours[0],
                hours[1],
                text.get("Streckenschaden", "") + text.get("StreckenschadenLfdNr", ""),
                text["Verbindung"] == "true",
                text.get("Kommentar", ""),
                text.get("Fotodatei", ""),
                "" if text["Parameter"] == "-" else text["Parameter"],
                number,
            )
        )
    return found


def as_written(inspection: Inspection) -> list[Observation]:
    """Our observations with texts as files hold them: one line, no control characters."""
    return [
        replace(o, remark=printable(o.remark), source="" if printable(o.source) == "-" else printable(o.source))
        for o in inspection.observations
    ]


def test_isybau_is_valid(schema) -> None:  # type: ignore[no-untyped-def]
    from lxml import etree

    assert schema.validate(etree.fromstring(isybau(whole(), OPTIONS))), schema.error_log


@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(inspection=any_inspection())
def test_any_inspection_is_valid_isybau_and_is_read_back(schema, inspection: Inspection) -> None:  # type: ignore[no-untyped-def]
    from lxml import etree

    xml = isybau(inspection, OPTIONS)
    assert schema.validate(etree.fromstring(xml)), schema.error_log
    assert xml.startswith(b"<?xml version='1.0' encoding='ISO-8859-1'?>")
    assert zustaende(xml) == as_written(inspection)
    points = ElementTree.fromstring(xml).findall(".//i:Sonderprofil/i:Koordinaten", SPACE)
    sheet = inspection.diameters[0]
    complete = sheet.verdict == "accept" and sheet.diameter_mm is not None and sheet.profile_mm and None not in sheet.profile_mm
    assert len(points) == (len(sheet.profile_mm) if complete else 0)
    for point, seen in zip(points, sheet.profile_mm if complete else (), strict=True):
        assert float(point[0].text or "") == pytest.approx(seen[0] / 1000, abs=6e-4)
        assert float(point[1].text or "") == pytest.approx(-seen[1] / 1000, abs=6e-4)


def test_isybau_states_the_measured_cross_section() -> None:
    root = ElementTree.fromstring(isybau(whole(), OPTIONS))
    assert [e.text for e in root.iterfind(".//i:RGrunddaten/i:HerkunftProfilmasse", SPACE)] == ["4"]
    assert [e.text for e in root.iterfind(".//i:RGrunddaten/i:Profilhoehe", SPACE)] == ["410"]
    unmeasured = replace(whole(), diameters=())
    root = ElementTree.fromstring(isybau(unmeasured, OPTIONS))
    assert [e.text for e in root.iterfind(".//i:RGrunddaten/i:HerkunftProfilmasse", SPACE)] == ["2"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"site": ""}, "site is empty"),
        ({"site": "S" * 256}, "is longer than the 255 letters"),
        ({"length": 1000.0}, "below 1000"),
        ({"date": None}, "date of the inspection is not known"),
    ],
)
def test_what_isybau_cannot_hold_is_said(change: dict[str, object], says: str) -> None:
    with pytest.raises(Invalid, match=says):
        isybau(replace(whole(), **change), Options())  # type: ignore[arg-type]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(inspection=any_inspection())
def test_the_en_text_makes_a_round_trip(inspection: Inspection) -> None:
    (block,) = read(en13508(inspection, OPTIONS))
    back = observations_of(block)
    kept = [
        replace(o, remark=o.remark.encode("latin-1", "replace").decode("latin-1"), source="") for o in as_written(inspection)
    ]
    assert list(back) == kept
    assert block.basics["AAD"] == printable(inspection.pipe.upstream.name).encode("latin-1", "replace").decode("latin-1")


def test_a_published_layout_is_read() -> None:
    (block,) = read(SAMPLE.encode("latin-1"))
    assert block.basics["AAA"] == "1"
    found = observations_of(block)
    assert [(o.station, o.code, o.continuous) for o in found] == [
        (0.0, "BCD", ""),
        (4.4, "BAB", "A1"),
        (5.4, "BAB", "B1"),
        (23.5, "BCE", ""),
    ]
    assert found[1].remark == "a, b"
    assert found[2].at_joint
    with pytest.raises(Invalid, match="no EN 13508-2 text"):
        read(b"hello")


def rows(data: bytes, name: str) -> list[dict[str, str]]:
    with zipfile.ZipFile(io.BytesIO(data)) as packed:
        return list(csv.DictReader(io.StringIO(packed.read(name).decode(), newline="")))


def test_pacp_tables_in_metres_and_feet() -> None:
    data, _, _ = export("pacp", whole(), OPTIONS)
    conditions = rows(data, "PACP_Conditions.csv")
    assert [row["Continuous"] for row in conditions if row["Continuous"]] == ["S1", "F1"]
    assert [row["Distance"] for row in conditions][3] == "4.20"
    assert rows(data, "PACP_Inspections.csv")[0]["Direction"] == "U"
    imperial, _, _ = export("pacp", whole(), replace(OPTIONS, imperial=True))
    assert [row["Distance"] for row in rows(imperial, "PACP_Conditions.csv")][3] == "13.78"
    assert rows(imperial, "PACP_Inspections.csv")[0]["IsImperial"] == "1"
    assert "not verified" in rows(imperial, "PACP_Inspections.csv")[0]["Additional_Info"]


def test_geojson_places_observations_between_the_nodes() -> None:
    data, _, _ = export("geojson", whole(), OPTIONS)
    found = json.loads(data)
    line, *points = found["features"]
    assert found["type"] == "FeatureCollection"
    (west, south), (east, north) = (line["geometry"]["coordinates"][k] for k in (1, 0))  # upstream inspection: M2 comes first
    assert west == pytest.approx(9.974, abs=0.01)  # EPSG:25832 at 565 km east is 65 km east of 9 degrees
    assert south == pytest.approx(53.54, abs=0.02)
    first, last = points[0], points[7]
    assert first["geometry"]["coordinates"] == [east, north]
    assert last["geometry"]["coordinates"] == [west, south]
    half = next(p for p in points if p["properties"]["code"] == "BAA")["geometry"]["coordinates"]
    assert math.dist(half, (east, north)) < math.dist(half, (west, south))
    assert [p["properties"]["kind"] for p in points].count("deviation") == 1


def test_gdal_reads_the_geojson(tmp_path: Path) -> None:
    data, name, _ = export("geojson", whole(), OPTIONS)
    (tmp_path / name).write_bytes(data)
    about, _, shapes, fields = pyogrio.raw.read(tmp_path / name)
    wanted = json.loads(data)["features"]
    assert about["crs"] == "EPSG:4326"
    read = dict(zip(about["fields"], fields, strict=True))
    assert list(read["kind"]) == [feature["properties"]["kind"] for feature in wanted]
    for shape, feature in zip(shapely.from_wkb(shapes), wanted, strict=True):
        assert shapely.geometry.mapping(shape)["type"] == feature["geometry"]["type"]
        assert shape.equals_exact(shapely.geometry.shape(feature["geometry"]), 1e-9)


@pytest.mark.parametrize(
    ("change", "says"),
    [({"crs": None}, "EPSG"), ({"crs": 1}, "no reference system"), ({"crs": 4326}, "do not lie in")],
)
def test_geojson_without_a_place_is_refused(change: dict[str, object], says: str) -> None:
    with pytest.raises(Invalid, match=says):
        export("geojson", replace(whole(), **change), OPTIONS)  # type: ignore[arg-type]


def test_the_report_has_its_texts_and_pictures_in_both_languages() -> None:
    english = PdfReader(io.BytesIO(export("pdf", whole(), OPTIONS)[0]))
    text = " ".join(page.extract_text() for page in english.pages)
    for wanted in (
        "M1-M2",
        "Connection",
        "401.0 mm",
        "398.0 mm",
        "refused: do not order",
        "28.30 m",
        "does not look along the pipe",
        "scale error within the interval 0.4 %",
        "Ann",
    ):
        assert wanted in text, wanted
    assert sum(len(page.images) for page in english.pages) == 1
    german = PdfReader(io.BytesIO(export("pdf", whole(), replace(OPTIONS, language="de", imperial=True))[0]))
    text = " ".join(page.extract_text() for page in german.pages)
    for wanted in ("Anschluss", "Haltungsgrafik", "15.79 in", "92.8 ft", "blickt nicht längs", "Geräte und Kalibrierung"):
        assert wanted in text, wanted


@settings(max_examples=15, deadline=None, derandomize=True)
@given(inspection=any_inspection())
def test_any_inspection_gives_a_report(inspection: Inspection) -> None:
    assert len(PdfReader(io.BytesIO(export("pdf", inspection, OPTIONS)[0])).pages) >= 2


def test_every_reason_to_refuse_a_diameter_is_worded_in_german() -> None:
    assert set(REASONS_DE) <= set(PROMPTS)
    for code in (
        "no_pipe",
        "few_points",
        "aim",
        "motion",
        "unstable",
        "wide_interval",
        "water",
        "camera_lost",
        "second_position",
    ):
        assert reason(code, "de") != reason(code, "en") != code


def test_points_and_scene_are_read_by_a_public_reader() -> None:
    cloud = trimesh.load(io.BytesIO(export("ply", whole(), OPTIONS)[0]), file_type="ply")
    assert np.allclose(cloud.vertices, [[0.2, 0.0, 2.0], [0.0, 0.2, 2.5]])
    scene = trimesh.load(io.BytesIO(export("gltf", whole(), OPTIONS)[0]), file_type="glb")
    assert scene.bounds[1][2] == pytest.approx(28.3, abs=0.05)
    assert len(scene.geometry) == 4  # the pipe, two landmarks that nobody rejected, one deviation
    with pytest.raises(Invalid, match="no point cloud"):
        export("ply", replace(whole(), clouds=()), OPTIONS)


def test_the_archive_names_every_file_with_its_hash_and_what_it_left_out() -> None:
    data, _, _ = export("zip", replace(whole(), crs=None), OPTIONS)
    with zipfile.ZipFile(io.BytesIO(data)) as packed:
        manifest = json.loads(packed.read("manifest.json"))
        assert sorted([*(f["name"] for f in manifest["files"]), "manifest.json"]) == sorted(packed.namelist())
        for file in manifest["files"]:
            assert hashlib.sha256(packed.read(file["name"])).hexdigest() == file["sha256"]
        assert "photos/M1-M2_001.jpg" in packed.namelist()
    assert list(manifest["left_out"]) == ["geojson"]
    assert export("zip", replace(whole(), crs=None), OPTIONS)[0] == data


def test_a_chamber_goes_out_with_its_objects_and_its_map() -> None:
    found = files("chambers", whole(), OPTIONS)
    assert found["chambers.csv"].decode("utf-8").splitlines()[1].startswith("12,M1,2,elbow,0.98,1.0,0.0,4.0")
    assert json.loads(found["chamber_12.json"])["links"][0]["target"] == "pipe 1"
    assert found["chamber_12.glb"][:4] == b"glTF"
    with pytest.raises(Invalid, match="no chamber"):
        files("chambers", replace(whole(), structures=()), OPTIONS)


def test_every_format_can_be_asked_for() -> None:
    for name in NAMES:
        data, file, mime = export(name, whole(), OPTIONS)
        assert data
        assert file
        assert "/" in mime
