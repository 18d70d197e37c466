"""What the API answers, for its document: the fields that are always there. More may come with them."""

from web_ui.answers import access, anomaly, box, diameter, errors, inspections, landmarks, site, structure, surveys

__all__ = ["access", "anomaly", "box", "diameter", "errors", "inspections", "landmarks", "site", "structure", "surveys"]
