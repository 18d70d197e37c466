"""ISYBAU XML 2013 (``1302-metadaten.xsd``, version 2013-02): master data of pipe and nodes, and the inspection.

The measured cross-section goes in as origin "Querschnittsvermessung" with its height and width, and point by point as a
special profile where the whole wall was seen. ISO-8859-1, as the format asks; other letters become character references.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import Decimal
from xml.etree import ElementTree

from device.errors import Invalid
from device.export.base import Options, day, fitting, printable
from device.inspections.model import DiameterSheet, Inspection, NodeRecord, Observation, PipeRecord

NAMESPACE = "http://www.ofd-hannover.la/Identifikation"
ENCODING = "ISO-8859-1"
_VERSION = "2013-02"
_MASTER, _STATE = "STA01", "ZUS01"
_ORDER = "1"
_RULES_2013 = "5"
_EN_13508_2011 = "8"
_SURVEYED = "4"  # U124 HerkunftProfil: Querschnittsvermessung
_FROM_MASTER_DATA = "2"
_SEEN_ON_SITE = "3"
_PIPE, _NODE = "1", "2"  # Objektart
_MANHOLE = "0"  # Knotentyp
_MATERIAL = {
    "PVC": "PVC",
    "concrete": "B",
    "clay": "STZ",
    "PE": "PE",
    "PP": "PP",
    "GRP": "GFK",
    "ductile iron": "GGG",
    "unknown": "W",
}
_SHAPE = {"circular": "0", "egg": "1", "oval": "12", "other": "13"}
_CAMERA = {"crawler": "2", "pushrod": "1", "rod": "3", "manhole": "3"}
_MOST_CONTINUOUS = 99


def isybau(inspection: Inspection, options: Options) -> bytes:
    """The file. Raises Invalid with a sentence for what the format cannot hold."""
    made = day(inspection, options)
    pipe = inspection.pipe
    root = ElementTree.Element("Identifikation", xmlns=NAMESPACE)
    _text(root, "Version", _VERSION)
    estate = _path(root, "Admindaten", "Liegenschaft")
    _text(estate, "Liegenschaftsnummer", fitting(inspection.site, 255, "The name of the site")[:20])
    _text(estate, "Liegenschaftsbezeichnung", fitting(inspection.site, 255, "The name of the site"))
    data = _path(root, "Datenkollektive")
    _text(data, "Datenstatus", "2")  # as recorded
    _text(data, "Erstellungsdatum", (options.made or made).isoformat())
    _collections(data, (options.made or made).isoformat())
    _master(data, pipe, inspection.diameters)
    _state(data, inspection, made.isoformat())
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding=ENCODING, xml_declaration=True)
    return text


def _collections(data: ElementTree.Element, made: str) -> None:
    names = _path(data, "Kennungen")
    for name, kind, what, flags in (
        (_MASTER, "1", "Stammdaten", ("Bautechnik", "Geometrie", "Sanierung", "Umfeld")),
        (_STATE, "2", "Zustandsdaten", ("Inspektion", "Dichtheit", "Film")),
    ):
        collection = _path(names, "Kollektiv")
        _text(collection, "Kennung", name)
        _text(collection, "Kollektivart", kind)
        about = _path(collection, "Kollektiveigenschaft", what)
        if what == "Stammdaten":
            _text(about, "Stammdatentyp", "1")
        for flag in flags:
            _text(about, flag, "true" if flag in ("Bautechnik", "Geometrie", "Inspektion") else "false")
        _text(collection, "Regelwerk", _RULES_2013)
        _text(collection, "Bearbeitungsstand", made)


def _master(data: ElementTree.Element, pipe: PipeRecord, sheets: Sequence[DiameterSheet]) -> None:
    master = _path(data, "Stammdatenkollektiv")
    _text(master, "Kennung", _MASTER)
    edge = _object(master, pipe.name, _PIPE, "The name of the pipe")
    about = _path(edge, "Kante")
    _text(about, "KantenTyp", "0")
    _nodes(about, pipe)
    if pipe.length is not None:
        _text(about, "Laenge", _decimal(pipe.length, 2, 10_000, "The length of the pipe"))
    _text(about, "Material", _MATERIAL.get(pipe.material, "W"))
    size = _size(pipe, sheets)
    measured = _outline(sheets)
    profile = _path(about, "Profil")
    _text(profile, "SonderprofilVorhanden", "true" if measured else "false")
    _text(profile, "Profilart", _SHAPE.get(pipe.shape, "13"))
    if size is not None:
        _text(profile, "Profilbreite", str(size[1]))
        _text(profile, "Profilhoehe", str(size[0]))
    if measured:
        outline = _path(profile, "Sonderprofil")
        for x, y in measured:
            point = _path(outline, "Koordinaten")
            _text(point, "X-Wert", f"{x / 1000:.3f}")
            _text(point, "Y-Wert", f"{y / 1000:.3f}")
    _path(about, "Haltung")
    for node in (pipe.upstream, pipe.downstream):
        manhole = _object(master, node.name, _NODE, "The name of a node")
        kind = _path(manhole, "Knoten")
        _text(kind, "KnotenTyp", _MANHOLE)
        _path(kind, "Schacht")
        if node.easting is not None and node.northing is not None:
            _place(manhole, node, node.easting, node.northing)


def _place(manhole: ElementTree.Element, node: NodeRecord, easting: float, northing: float) -> None:
    point = _path(manhole, "Geometrie", "Geometriedaten", "Knoten", "Punkt")
    _text(point, "Rechtswert", _decimal(easting, 3, 100_000_000, f"The easting of {node.name}"))
    _text(point, "Hochwert", _decimal(northing, 3, 10_000_000, f"The northing of {node.name}"))
    if node.level is not None:
        _text(point, "Punkthoehe", _decimal(node.level, 3, 10_000, f"The level of {node.name}"))
    _text(point, "PunktattributAbwasser", "DMP")


def _state(data: ElementTree.Element, inspection: Inspection, made: str) -> None:
    pipe = inspection.pipe
    state = _path(data, "Zustandsdatenkollektiv")
    _text(state, "Kennung", _STATE)
    order = _path(state, "Auftraege", "Auftrag")
    _text(order, "Auftragsbezeichnung", f"{inspection.site} {inspection.number}"[:60])
    _text(order, "Auftragskennung", _ORDER)
    _text(order, "Auftragsart", "1")
    _text(order, "Kodiersystem", _EN_13508_2011)
    seen = _path(state, "InspizierteAbwassertechnischeAnlage")
    _text(seen, "Objektbezeichnung", fitting(pipe.name, 30, "The name of the pipe"))
    _text(seen, "Anlagentyp", "1")
    visual = _path(seen, "OptischeInspektion")
    _text(visual, "Auftragskennung", _ORDER)
    _text(visual, "Inspektionsdatum", made)
    _text(visual, "Inspektionsverfahren", "2" if inspection.method == "manhole" else "0")
    if printable(inspection.operator):
        _text(visual, "NameUntersucher", fitting(inspection.operator, 40, "The name of the operator"))
    if inspection.date and len(inspection.date) > 10:
        _text(visual, "Uhrzeit", inspection.date[11:19])
    if printable(inspection.note):
        _text(visual, "Bemerkung", printable(inspection.note))
    way = _path(visual, "Rohrleitung")
    _text(way, "Rohrleitungstyp", "0")
    _text(way, "Inspektionsrichtung", "O" if inspection.direction == "downstream" else "U")
    _text(way, "BezugspunktLage", "3")
    if inspection.length is not None:
        _text(way, "Inspektionslaenge", _decimal(inspection.length, 2, 1000, "The inspected length"))
    _text(way, "Inspektionsart", _CAMERA[inspection.method])
    basics = _path(way, "RGrunddaten")
    _nodes(basics, pipe)
    size = _size(pipe, inspection.diameters)
    if size is not None:
        surveyed = _accepted(inspection.diameters) is not None
        _text(basics, "HerkunftProfilmasse", _SURVEYED if surveyed else _FROM_MASTER_DATA)
        _text(basics, "Profilhoehe", str(size[0]))
        _text(basics, "Profilbreite", str(size[1]))
    _text(basics, "Profilart", _SHAPE.get(pipe.shape, "13"))
    _text(basics, "HerkunftMaterial", _SEEN_ON_SITE if pipe.material == "unknown" else _FROM_MASTER_DATA)
    _text(basics, "Material", _MATERIAL.get(pipe.material, "W"))
    if inspection.observations:
        findings = _path(way, "Inspektionsdaten")
        for one in inspection.observations:
            _observation(_path(findings, "RZustand"), one)


def _observation(element: ElementTree.Element, one: Observation) -> None:
    _text(element, "Station", _decimal(one.station, 2, 1000, f"The station of {one.code}"))
    _text(element, "Parameter", printable(one.source) or "-")
    _text(element, "InspektionsKode", one.code)
    for name, value in (("Charakterisierung1", one.ch1), ("Charakterisierung2", one.ch2)):
        if value:
            _text(element, name, value)
    _text(element, "Verbindung", "true" if one.at_joint else "false")
    for name, amount in (("Quantifizierung1Numerisch", one.q1), ("Quantifizierung2Numerisch", one.q2)):
        if amount is not None:
            _text(element, name, _decimal(amount, 2, 10_000, f"The quantification of {one.code}"))
    if one.continuous:
        if int(one.continuous[1:]) > _MOST_CONTINUOUS:
            raise Invalid(f"ISYBAU holds {_MOST_CONTINUOUS} continuous defects in a pipe, there are more.")
        _text(element, "Streckenschaden", one.continuous[0])
        _text(element, "StreckenschadenLfdNr", one.continuous[1:])
    for name, hour in (("PositionVon", one.clock_from), ("PositionBis", one.clock_to)):
        if hour is not None:
            _text(element, name, str(hour))
    if one.photo:
        _text(element, "Fotodatei", fitting(one.photo, 255, "The name of a photo"))
        _text(element, "Fotonummer", str(one.number))
    if printable(one.remark):
        _text(element, "Kommentar", printable(one.remark))


def _accepted(sheets: Sequence[DiameterSheet]) -> DiameterSheet | None:
    return next((sheet for sheet in sheets if sheet.verdict == "accept" and sheet.diameter_mm is not None), None)


def _size(pipe: PipeRecord, sheets: Sequence[DiameterSheet]) -> tuple[int, int] | None:
    """(height, width) in mm: measured where that was accepted, else the map's DN of a round pipe."""
    sheet = _accepted(sheets)
    if sheet is not None and sheet.diameter_mm is not None:
        whole = _outline([sheet])
        if whole:
            across, down = ([point[k] for point in whole] for k in (0, 1))
            return round(max(down) - min(down)), round(max(across) - min(across))
        return round(sheet.diameter_mm), round(sheet.diameter_mm)
    return (pipe.dn_mm, pipe.dn_mm) if pipe.dn_mm is not None and pipe.shape == "circular" else None


def _outline(sheets: Sequence[DiameterSheet]) -> list[tuple[float, float]]:
    """The cross-section (x, y) in mm with y upwards, where the whole of it was seen."""
    sheet = _accepted(sheets)
    if sheet is None or not sheet.profile_mm:
        return []
    seen = [(x, -y) for point in sheet.profile_mm if point is not None for x, y in [point]]
    whole = len(seen) == len(sheet.profile_mm) and all(math.isfinite(v) for point in seen for v in point)
    return seen if whole else []


def _nodes(element: ElementTree.Element, pipe: PipeRecord) -> None:
    for name, node in (("KnotenZulauf", pipe.upstream), ("KnotenAblauf", pipe.downstream)):
        _text(element, name, fitting(node.name, 30, "The name of a node"))
        _text(element, f"{name}Typ", _MANHOLE)


def _object(parent: ElementTree.Element, name: str, kind: str, what: str) -> ElementTree.Element:
    found = _path(parent, "AbwassertechnischeAnlage")
    _text(found, "Objektbezeichnung", fitting(name, 30, what))
    _text(found, "Objektart", kind)
    return found


def _decimal(value: float, digits: int, below: float, what: str) -> str:
    """``value`` with ``digits`` behind the point. Raises Invalid where the format has no room for it."""
    if not math.isfinite(value) or abs(value) >= below - 0.5 * 10**-digits:
        raise Invalid(f"{what} is {value:g}, but ISYBAU holds numbers below {below:g} only.")
    return str(Decimal(repr(value)).quantize(Decimal(1).scaleb(-digits)))


def _path(parent: ElementTree.Element, *names: str) -> ElementTree.Element:
    """New elements, each in the one before; the last one."""
    for name in names:
        parent = ElementTree.SubElement(parent, name)
    return parent


def _text(parent: ElementTree.Element, name: str, text: str) -> None:
    ElementTree.SubElement(parent, name).text = text
