#!/usr/bin/env python3
"""Checks a server's OpenAPI document with programs of others, and uses a client that one writes.

    openapi.py 127.0.0.1:8080 MAP FRAME FOLDER

The document is validated, and a Python client is generated from it into FOLDER. With it, a map is
made, MAP is asked, a heat map is fetched, what is wrong is refused, and the new map is deleted.
Damaged documents have to be refused: they show that the checks see something.
"""

import copy
import importlib
import json
import subprocess
import sys
import urllib.request
from pathlib import Path
from urllib.parse import urljoin

from openapi_spec_validator import OpenAPIV31SpecValidator

# Requests to the local network must not go through a proxy.
OPENER = urllib.request.build_opener(urllib.request.ProxyHandler({}))
# Files that the generator does not know are bytes; its code needs no formatting.
FILES = ("image/png", "application/x-npy", "application/x-tar")
CONFIG = {
    "project_name_override": "generated",
    "package_name_override": "generated",
    "post_hooks": [],
    "content_type_overrides": dict.fromkeys(FILES, "application/octet-stream")
    | {"text/event-stream": "text/plain"},
}


def errors(document):
    """What the validator finds."""
    return [error.message for error in OpenAPIV31SpecValidator(document).iter_errors()]


def generate(document, folder):
    """Writes a client; what the generator complains about, empty if nothing."""
    folder.mkdir()
    (folder / "openapi.json").write_text(json.dumps(document))
    # JSON is YAML.
    (folder / "config.yaml").write_text(json.dumps(CONFIG))
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--fail-on-warning"]
    options = ["--path", "openapi.json", "--config", "config.yaml", "--meta", "none"]
    done = subprocess.run(
        [*command, *options, "--output-path", "generated"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    return "" if done.returncode == 0 else done.stdout + done.stderr


def damaged(document, change):
    """A copy with a change."""
    document = copy.deepcopy(document)
    change(document["paths"]["/v1/maps/{name}/export/{file}"]["get"])
    return document


def without_name(operation):
    """A parameter of the path that is not described."""
    operation["parameters"] = [item for item in operation["parameters"] if item["name"] != "name"]


def with_text_in_path(operation):
    """An option that is said to be in the path, which has no place for it."""
    for item in operation["parameters"]:
        if item["name"] == "text":
            item |= {"in": "path", "required": True}


def shapeless(node):
    """Schemas that say no more than "object"."""
    if isinstance(node, list):
        return [found for item in node for found in shapeless(item)]
    if not isinstance(node, dict):
        return []
    known = {"properties", "additionalProperties", "allOf", "oneOf", "anyOf"}
    here = [node] if node.get("type") == "object" and not known & set(node) else []
    return here + shapeless(list(node.values()))


def check_document(document, folder):
    """Validator and generator take the document, and no damaged one."""
    assert not errors(document), errors(document)
    assert errors(damaged(document, without_name)), "the validator sees nothing"
    complaints = generate(document, folder / "good")
    assert not complaints, complaints
    broken = damaged(document, with_text_in_path)
    assert generate(broken, folder / "bad"), "the generator sees nothing"
    assert not shapeless(document), shapeless(document)

    for path, item in document["paths"].items():
        for method, operation in item.items():
            what = f"{method} {path}"
            for parameter in operation.get("parameters", []):
                is_in_path = "{" + parameter["name"] + "}" in path
                assert (parameter["in"] == "path") == is_in_path, f"{what}: {parameter['name']}"
            for status, answer in operation["responses"].items():
                for kind, content in answer.get("content", {}).items():
                    schema = content.get("schema", {})
                    is_file = not (kind.startswith("text/") or kind.endswith("json"))
                    is_binary = (schema.get("type"), schema.get("format")) == ("string", "binary")
                    assert is_binary == is_file, f"{what} {status}: {kind} is {schema}"
            if path.startswith("/v1/maps"):
                assert {"401", "403", "default"} <= set(operation["responses"]), what
    for path in ("query", "render", "export/{file}"):
        for operation in document["paths"][f"/v1/maps/{{name}}/{path}"].values():
            assert "429" in operation["responses"], path


def use(address, name, frame):
    """Makes, asks and deletes maps with the generated client."""
    client = importlib.import_module("generated").Client(base_url=f"http://{address}")
    models = importlib.import_module("generated.models")

    def call(tag, operation, *arguments, **options):
        module = importlib.import_module(f"generated.api.{tag}.{operation}")
        return module.sync_detailed(*arguments, client=client, **options)

    made = call("maps", "create_map", body=models.NewMap(name="generated"))
    assert (made.status_code, made.parsed.name) == (201, "generated"), made
    again = call("maps", "create_map", body=models.NewMap(name="generated"))
    assert again.status_code == 409 and isinstance(again.parsed, models.Problem), again
    names = [status.name for status in call("maps", "list_maps").parsed.maps]
    assert {name, "generated"} <= set(names), names

    question = models.Question(text="chair", view=models.View(frame=frame))
    asked = call("query", "query_map", name, body=question, wait="settled")
    assert asked.status_code == 200 and isinstance(asked.parsed, models.Answer), asked
    heatmap = asked.parsed.heatmap
    picture = call("query", "get_heatmap", name, asked.parsed.query_id)
    assert picture.status_code == 200, picture
    assert picture.parsed.payload.read(8) == b"\x89PNG\r\n\x1a\n", picture
    link = urljoin(f"http://{address}/v1/maps/{name}/query", heatmap.url)
    assert OPENER.open(link).read() == picture.content
    found = call("query", "query_map", name, body=models.Question(text="chair"))
    assert all(len(item.center_metres) == 3 for item in found.parsed.objects), found
    question = models.Question(texts=["chair", "wall"])
    labelled = call("query", "query_map", name, body=question)
    assert isinstance(labelled.parsed, models.Segmentation), labelled
    mesh = call("maps", "export_map", name, "trajectory.tum", up="map")
    assert mesh.status_code == 200 and mesh.parsed.payload.read(), mesh
    wrong = call("maps", "export_map", name, "mesh.ply", voxel_metres=9.0)
    assert (wrong.status_code, wrong.parsed.field) == (400, "voxel_metres"), wrong

    gone = call("maps", "delete_map", "generated")
    assert gone.status_code == 204, gone
    missing = call("maps", "get_map", "generated")
    assert missing.status_code == 404 and missing.parsed.field == "name", missing


def main():
    address, name, frame, folder = sys.argv[1:]
    folder = Path(folder)
    document = json.loads(OPENER.open(f"http://{address}/openapi.json").read())
    check_document(document, folder)
    sys.path.insert(0, str(folder / "good"))
    use(address, name, int(frame))
    print(f"{len(document['paths'])} paths are described")


if __name__ == "__main__":
    main()
