"""Caches of functions: what is kept without a bound in bytes is small by its nature."""

import ast
from collections.abc import Iterator

from tests.test_sizes import PRODUCT, ROOT

#: Functions whose last values are bounded by number alone, and why that is enough. A chain has as
#: many joints as a robot, so its tables take kilobytes.
BY_NUMBER = {
    "kinematics/ik/closed_form/arm_parts.py": "parts of a chain",
    "kinematics/ik/closed_form/structure.py": "a few numbers of a chain",
    "kinematics/ik/closed_form/analytic.py": "a few numbers of a chain",
    "kinematics/ik/numeric/numeric.py": "tables of a chain",
    "kinematics/ik/decoupled.py": "a few numbers of a chain",
    "tracking/controllers/controller.py": "a law of a few controllers",
    "dynamics/model/body.py": "a row of numbers for each link of a chain",
    "dynamics/parameters/base_parameters.py": "matrices of a chain",
    "planning/search/rrt_connect.py": "a number",
    "planning/timing/choice.py": "limits of a chain's joints",
    "service/http/layer/request_checks.py": "whether a host is allowed",
    "service/http/request_headers.py": "whether a header names gzip",
    "client/armwright_client/call.py": "a path",
    "service/storage/caches/prepared_files.py": "a path",
    "service/storage/caches/cache_key.py": "a name",
}

#: Functions that keep all values: of kernels, of files of ours, of functions of the client.
WITHOUT_A_BOUND = {
    ("compiled/compiler/machine_code.py", "copied"),
    ("compiled/compiler/machine_code.py", "_environments"),
    ("compiled/compiler/machine_code.py", "_size"),
    ("compiled/compiler/library.py", "_plain_machine"),
    ("compiled/compiler/store.py", "_warn_once"),
    ("kinematics/ik/closed_form/analytic.py", "_signs"),
    ("obstacles/collision/checker.py", "_direct"),
    ("obstacles/scenes/scene.py", "_field_names"),
    ("obstacles/convex/triangles.py", "_inner_radius"),
    ("obstacles/robots/visual_geometry.py", "_looks"),
    ("service/viewer/page.py", "_asset"),
    ("client/armwright_client/call.py", "_method"),
}


def caches(name: str) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Files and functions of the product that are decorated by a cache of functools."""
    for folder in (*PRODUCT, "studio", "client/armwright_client"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            text = path.read_text()
            for node in ast.walk(ast.parse(text if f"@{name}" in text else "")):
                if isinstance(node, ast.FunctionDef):
                    for decorator in node.decorator_list:
                        called = decorator.func if isinstance(decorator, ast.Call) else decorator
                        if isinstance(called, ast.Name) and called.id == name:
                            yield path.relative_to(ROOT).as_posix(), node


def test_caches_are_bounded_by_bytes_where_values_may_be_large() -> None:
    assert {path for path, _ in caches("lru_cache")} == set(BY_NUMBER)


def test_caches_without_any_bound_have_one_value_for_each_of_a_few_types_or_words() -> None:
    with_arguments = {
        (path, function.name) for path, function in caches("cache") if ast.unparse(function.args)
    }
    assert with_arguments == WITHOUT_A_BOUND
