"""Files for operators: their schemas hold, and they name settings and metrics that exist."""

import json
import re
from pathlib import Path
from typing import Any

import kubernetes_validate
import promql_parser
import pytest
import yaml
from compose_spec import PyCompose
from fastapi import FastAPI

from service.http.metrics import Metrics
from service.settings import Settings
from service.storage import messages
from service.storage.stores.job_store import STATUSES
from service.version import VERSION
from service.workers.state import Counters

DEPLOY = Path(__file__).parents[2] / "deploy"
KUBERNETES = [
    (path.name, document)
    for path in sorted((DEPLOY / "kubernetes").glob("*.yaml"))
    for document in yaml.safe_load_all(path.read_text("utf-8"))
]
#: The version whose schemas manifests follow.
_VERSION = "1.32"
#: Kinds of KEDA, which Kubernetes has no schemas of.
_KEDA = ("ScaledObject", "TriggerAuthentication")
#: Fields of KEDA's ScaledObject, of its triggers, and what its PostgreSQL scaler reads (KEDA,
#: "ScaledObject specification" and "PostgreSQL scaler").
_SCALED = {
    "advanced", "cooldownPeriod", "fallback", "idleReplicaCount", "initialCooldownPeriod",
    "maxReplicaCount", "minReplicaCount", "pollingInterval", "scaleTargetRef", "triggers",
}  # fmt: skip
_TRIGGER = {"type", "metadata", "authenticationRef", "name", "metricType", "useCachedMetrics"}
_POSTGRESQL = {"query", "targetQueryValue", "activationTargetQueryValue"}


class _Supervisor:
    """The numbers that metrics ask of a supervisor."""

    waiting = background_waiting = count = alive = busy = spare = started_workers = 0
    counters = Counters()


def metrics() -> str:
    """All metrics of a service, after a request and a plan."""
    app = FastAPI()
    app.state.supervisor = _Supervisor()
    counted = Metrics(app)
    counted.count_request("/v1/plan", "POST", 200, 0.1)
    counted.count_plan("rrt_connect", [("rrt_connect", 0.1)])
    return counted.text(dict.fromkeys(STATUSES, 0), 0).decode()


def expressions() -> list[str]:
    """Every query of the alerts and of the dashboard."""
    alerts = yaml.safe_load((DEPLOY / "prometheus/alerts.yaml").read_text("utf-8"))
    rules = [rule for group in alerts["groups"] for rule in group["rules"]]
    dashboard = json.loads((DEPLOY / "grafana/armwright.json").read_text("utf-8"))
    targets = [target for panel in dashboard["panels"] for target in panel["targets"]]
    return [part["expr"] for part in (*rules, *targets)]


@pytest.mark.parametrize("expression", expressions())
def test_a_query_is_one_and_asks_for_metrics_and_labels_that_exist(expression: str) -> None:
    promql_parser.parse(expression)
    known = metrics()
    names = re.findall(r"armwright_\w+", expression)
    assert names
    for name in names:
        assert re.search(rf"^{name}[ {{]", known, re.MULTILINE), name
    for name, label, value in re.findall(r'(armwright_\w+)\{(\w+)="(\w+)"', expression):
        assert re.search(rf'^{name}\{{[^}}]*{label}="{value}"', known, re.MULTILINE), value
    for labels in re.findall(r"by \(([\w, ]+)\)", expression):
        for label in set(labels.split(", ")) - {"instance"}:
            assert f'{label}="' in known, label


@pytest.mark.parametrize(("file", "document"), KUBERNETES)
def test_a_manifest_follows_the_schema_of_its_kind(file: str, document: dict[str, Any]) -> None:
    if document["kind"] in _KEDA:
        assert document["apiVersion"] == "keda.sh/v1alpha1"
        return
    kubernetes_validate.validate(document, _VERSION, strict=True)


def test_manifests_name_settings_ports_and_labels_that_exist() -> None:
    deployments = [d for _, d in KUBERNETES if d["kind"] == "Deployment"]
    names = {d["metadata"]["name"] for d in deployments}
    assert names == {"armwright-server", "armwright-agent"}
    for deployment in deployments:
        (container,) = deployment["spec"]["template"]["spec"]["containers"]
        for variable in container["env"]:
            assert variable["name"].removeprefix("ARMWRIGHT_").lower() in Settings.model_fields
        ports = {port["name"] for port in container["ports"]}
        for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
            assert container[probe]["httpGet"]["port"] in ports
            assert container[probe]["httpGet"]["path"] in ("/readyz", "/healthz")
    for _, document in KUBERNETES:
        target = document.get("spec", {}).get("scaleTargetRef", {}).get("name")
        assert target is None or target in names
    (scaled,) = (d for _, d in KUBERNETES if d["kind"] == "ScaledObject")
    assert set(scaled["spec"]) <= _SCALED
    (trigger,) = scaled["spec"]["triggers"]
    assert set(trigger) <= _TRIGGER
    assert set(trigger["metadata"]) <= _POSTGRESQL
    assert float(trigger["metadata"]["targetQueryValue"]) > 0.0
    (secret,) = (d for _, d in KUBERNETES if d["kind"] == "TriggerAuthentication")
    assert trigger["authenticationRef"]["name"] == secret["metadata"]["name"]
    assert {one["parameter"] for one in secret["spec"]["secretTargetRef"]} == {"connection"}
    assert f"queue_name = '{messages.QUEUE}'" in scaled["spec"]["triggers"][0]["metadata"]["query"]


def test_manifests_are_closed_as_shipped() -> None:
    texts = [path.read_text("utf-8") for path in DEPLOY.rglob("*.yaml")]
    texts.append((DEPLOY.parent / "compose.yaml").read_text("utf-8"))
    assert not any("ARMWRIGHT_INSECURE" in text for text in texts)
    images = re.findall(r"image: (\S+)", "\n".join(texts))
    assert images
    for image in images:
        assert re.fullmatch(r"\w+:\d[\w.]+", image), image
        name, _, version = image.partition(":")
        assert name != "armwright" or version == VERSION
    covered = {
        d["spec"]["podSelector"]["matchLabels"]["component"]
        for _, d in KUBERNETES
        if d["kind"] == "NetworkPolicy"
    }
    secrets = set()
    for _, document in KUBERNETES:
        if document["kind"] == "TriggerAuthentication":
            secrets |= {one["key"] for one in document["spec"]["secretTargetRef"]}
        if document["kind"] != "Deployment":
            continue
        spec = document["spec"]["template"]["spec"]
        assert document["spec"]["strategy"]["type"] == "Recreate"
        assert document["metadata"]["labels"]["component"] in covered
        assert spec["automountServiceAccountToken"] is False
        assert spec["securityContext"]["seccompProfile"]["type"] == "RuntimeDefault"
        refs = [
            v["valueFrom"]["secretKeyRef"] for v in spec["containers"][0]["env"] if "valueFrom" in v
        ]
        secrets |= {ref["key"] for ref in refs if ref["name"] == "armwright"}
    told = (DEPLOY / "kubernetes/server.yaml").read_text("utf-8")
    assert secrets == set(re.findall(r"--from-literal=([\w-]+)=", told))


def test_the_compose_file_follows_its_specification() -> None:
    text = (DEPLOY / "compose/compose.yaml").read_text("utf-8")
    compose = PyCompose.from_json(json.dumps(yaml.safe_load(text)))
    compose.validate()
    assert sorted(compose.service_names()) == [
        "agent-1", "agent-2", "db", "proxy", "server-1", "server-2",
    ]  # fmt: skip
    services = yaml.safe_load(text)["services"]
    for name, service in services.items():
        for variable in service.get("environment", {}):
            known = variable.removeprefix("ARMWRIGHT_").lower() in Settings.model_fields
            assert known or name in ("db", "proxy"), variable
    assert services["agent-1"]["environment"]["ARMWRIGHT_DATABASE_URL"].startswith("postgresql")
    caddy = (DEPLOY / "compose/Caddyfile").read_text("utf-8")
    assert "server-1:8000 server-2:8000" in caddy
    with pytest.raises(Exception, match="imag"):
        PyCompose.from_json(json.dumps({"services": {"x": {"imag": "y"}}})).validate()
