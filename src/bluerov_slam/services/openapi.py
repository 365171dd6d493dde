"""The OpenAPI document of a route table, and the page that shows it without asking anyone else."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, Final, Protocol


class DocumentedRoute(Protocol):
    """What the document needs of a route."""

    @property
    def method(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def summary(self) -> str: ...
    @property
    def documented(self) -> bool: ...
    @property
    def body(self) -> Mapping[str, Any] | None: ...


DOCS_PAGE: Final = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>API</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="static/vendor/swagger-ui-dist/swagger-ui.css">
</head>
<body>
<div id="swagger-ui"></div>
<script src="static/vendor/swagger-ui-dist/swagger-ui-bundle.js"></script>
<script src="docs/start.js"></script>
</body>
</html>
"""
# validatorUrl null: otherwise Swagger UI sends the document's address to a public validator.
DOCS_SCRIPT: Final = b"""SwaggerUIBundle({
  url: 'openapi.json', dom_id: '#swagger-ui', validatorUrl: null, deepLinking: true,
  presets: [SwaggerUIBundle.presets.apis],
});
"""
_ERROR: Final = {
    "description": "What happened and how to cure it",
    "content": {
        "application/json": {
            "schema": {"type": "object", "required": ["error"], "properties": {"error": {"type": "string"}}}
        }
    },
}


def openapi_document(title: str, description: str, version: str, routes: Iterable[DocumentedRoute]) -> dict[str, Any]:
    """OpenAPI 3.0 of the documented routes; addresses are relative, so that it works behind BlueOS's prefix."""
    paths: dict[str, dict[str, Any]] = {}
    for route in routes:
        if route.documented:
            path = re.sub(r"\{(\w+):[^}]*\}", r"{\1}", route.path)
            paths.setdefault(path, {})[route.method.lower()] = _operation(route, path)
    return {
        "openapi": "3.0.3",
        "info": {"title": title, "description": description, "version": version},
        "servers": [{"url": "./"}],
        "paths": paths,
    }


def _operation(route: DocumentedRoute, path: str) -> dict[str, Any]:
    operation: dict[str, Any] = {
        "summary": route.summary,
        "responses": {"200": {"description": "OK"}, "default": _ERROR},
    }
    names = re.findall(r"\{(\w+)\}", path)
    if names:
        operation["parameters"] = [
            {"name": name, "in": "path", "required": True, "schema": {"type": "string"}} for name in names
        ]
    if route.body is not None:
        operation["requestBody"] = {"required": True, "content": {"application/json": {"schema": route.body}}}
    return operation
