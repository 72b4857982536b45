"""The form of a drawing's upload, for OpenAPI; `service.api.bodies` reads it."""

from __future__ import annotations

from service.api.schemas.base import JsonObject
from service.domain.formats import Purpose, listed

FORM: JsonObject = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["file"],
                    "properties": {
                        "file": {
                            "type": "string",
                            "format": "binary",
                            "description": f"{listed(Purpose.DRAWING)}; its own bytes decide, not its name.",
                        },
                        "scale": {
                            "type": "string",
                            "contentMediaType": "application/json",
                            "description": 'The scale as JSON: {"metres_per_unit"}, or {"ratio", "dpi"}, or '
                            '{"known_length": {"x1", "y1", "x2", "y2", "length_m"}}, or '
                            '{"known_lengths": [...]}.',
                        },
                        "metres_per_unit": {
                            "type": "number",
                            "description": "Or: metres a pixel or drawing unit.",
                        },
                        "ratio": {"type": "string", "description": "Or: 100 or 1:100, with dpi."},
                        "dpi": {"type": "number", "description": "Pixels an inch of the sheet."},
                        "known_length": {
                            "type": "string",
                            "description": "Or: x1,y1,x2,y2,L; two points (px, y down, or drawing units) and "
                            "the metres between them; several lengths with `;` between.",
                        },
                        "page": {
                            "type": "integer",
                            "minimum": 1,
                            "description": "Page of a PDF or TIFF, counted from 1.",
                        },
                        "storey": {"type": "string", "description": "Storey of a building model, by name."},
                        "cut_height_m": {
                            "type": "number",
                            "description": "Height above the storey's floor at which a model is cut.",
                        },
                        "wall_layers": {
                            "type": "string",
                            "contentMediaType": "application/json",
                            "description": "The layers of a vector file that hold its walls: a JSON list.",
                        },
                        "edits": {
                            "type": "string",
                            "contentMediaType": "application/json",
                            "description": "Corrections: a JSON list, as `PATCH` takes it.",
                        },
                        "replaces": {
                            "type": "string",
                            "description": "Id of a drawing of the same map of which this is a new issue: "
                            "what was said of that one holds for this one, its corrections included.",
                        },
                    },
                },
            }
        },
    }
}
