"""Generate clients of the API in Python and TypeScript from its OpenAPI document.

    python scripts/generated_clients.py [FOLDER] [--url URL]

Writes `openapi.json`, the package `armwright_api_client` and, where npm is there, the types
`armwright_api.ts` with a first request `plan.ts`, which the TypeScript compiler checks and, with
`--url`, Node.js sends to the service there. npm fetches its tools from its registry.
"""

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import openapi_python_client
from openapi_python_client.config import Config, ConfigFile, MetaType

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from service.app import create_app  # noqa: E402

PACKAGE = "armwright_api_client"
#: What generates and checks the types, by their versions.
_NODE_PACKAGES = ("openapi-typescript@7.13.0", "openapi-fetch@0.17.0", "typescript@5.9.3")
#: A first request, which names every field by its type.
_FIRST_PLAN = """\
import createClient from "openapi-fetch";
import type { paths } from "./armwright_api";

declare const process: { argv: string[] };
const armwright = createClient<paths>({ baseUrl: process.argv[2] ?? "http://127.0.0.1:8000" });
const { data, error } = await armwright.POST("/v1/plan", {
  body: {
    robot: "panda",
    start: { state: "home" },
    goal: { joints: [1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785] },
  },
});
if (data !== undefined && "trajectory" in data) {
  console.log(data.planner, data.trajectory.duration, data.certificate.min_clearance);
} else {
  console.log(error);
}
"""


def write_document(folder: Path) -> Path:
    """Write the OpenAPI document of the service."""
    file = folder / "openapi.json"
    file.write_text(json.dumps(create_app().openapi()), "utf-8")
    return file


def generate_python(document: Path, folder: Path) -> list[str]:
    """Generate the Python package.

    Args:
        document: The OpenAPI document.
        folder: Where the package's folder will be.

    Returns:
        Warnings and errors of the generator.
    """
    options: dict[str, Any] = {
        "content_type_overrides": {"application/xml": "text/plain"},  # read as text
        "post_hooks": [],
    }
    config = Config.from_sources(
        ConfigFile(**options),
        MetaType.NONE,
        document_source=document,
        file_encoding="utf-8",
        overwrite=True,
        output_path=folder / PACKAGE,
    )
    errors = openapi_python_client.generate(config=config)
    return [f"{error.header}: {error.detail}" for error in errors]


def generate_types(document: Path, folder: Path) -> None:
    """Generate the types for TypeScript, and check a first request with them."""
    (folder / "package.json").write_text('{"private": true, "type": "module"}', "utf-8")
    (folder / "plan.ts").write_text(_FIRST_PLAN, "utf-8")
    commands = (
        ("npm", "install", "--silent", "--no-audit", "--no-fund", *_NODE_PACKAGES),
        ("npx", "openapi-typescript", document.name, "-o", "armwright_api.ts",
         "--default-non-nullable", "false"),
        ("npx", "tsc", "--strict", "--skipLibCheck", "--target", "es2022",
         "--module", "esnext", "--moduleResolution", "bundler", "plan.ts"),
    )  # fmt: skip
    for command in commands:
        subprocess.run(command, cwd=folder, check=True)


def run_first_plan(folder: Path, url: str) -> str:
    """Send the first request to a running service; the line that it prints.

    Args:
        folder: With the client that was generated.
        url: Of the service.
    """
    command = ["node", "plan.js", url]
    answer = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    return answer.stdout.strip()


def main() -> None:
    """Generate both clients."""
    parser = argparse.ArgumentParser(description="Generate clients of the API.")
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "build/clients")
    parser.add_argument("--url", help="a running service to which plan.ts is sent")
    asked = parser.parse_args()
    folder: Path = asked.folder
    folder.mkdir(parents=True, exist_ok=True)
    document = write_document(folder)
    warnings = generate_python(document, folder)
    print("\n".join([f"{folder / PACKAGE}: {len(warnings)} warnings", *warnings]))
    if shutil.which("npm") is None:
        print("npm is not there: no types for TypeScript")
        return
    generate_types(document, folder)
    print(f"{folder / 'armwright_api.ts'}: types, and plan.ts has been checked with them")
    if asked.url is not None:
        print("plan.ts:", run_first_plan(folder, asked.url))


if __name__ == "__main__":
    main()
